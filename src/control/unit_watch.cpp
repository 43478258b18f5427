#include "helix_arm/control/unit_watch.hpp"

#include <algorithm>
#include <cstdio>

#include "helix_arm/basics/quote.hpp"

namespace helix_arm::control {
namespace {

std::string warningText(const std::string& what, double largest, const std::string& taker) {
  char text[256];
  std::snprintf(text, sizeof text,
                "all pressures of %s are at most %g Pa, which looks like kPa; %s gauge pressures "
                "in Pa, so 200 kPa are 200000",
                what.c_str(), largest, taker.c_str());
  return text;
}

}  // namespace

void UnitWatch::note(double now, const std::string& commander, double largest) {
  if (!(largest > 0)) return;
  auto found = records_.find(commander);
  if (found == records_.end()) {
    if (records_.size() >= kMost) return;
    found = records_.emplace(commander, Record{now, 0, false}).first;
  }
  Record& record = found->second;
  record.largest = std::max(record.largest, largest);
  if (record.largest >= kSuspicious) record.settled = true;
}

std::string UnitWatch::warning(double now) {
  for (auto& [commander, record] : records_) {
    if (record.settled || now - record.since < kPatience) continue;
    record.settled = true;
    return warningText(basics::quoted(commander), record.largest, "pressure_target takes");
  }
  return {};
}

std::string kilopascalWarning(const std::string& what, const model::Arm& arm,
                              const Eigen::Ref<const Eigen::MatrixXd>& inputs) {
  double largest = 0;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    if (!model::isPressure(arm.actuator(i).drive)) continue;
    for (const double pressure : inputs.col(i)) {
      if (!(pressure >= 0 && pressure < UnitWatch::kSuspicious)) return {};
      largest = std::max(largest, pressure);
    }
  }
  return largest > 0 ? warningText(what, largest, "expected") : std::string();
}

}  // namespace helix_arm::control
