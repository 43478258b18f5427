#include "helix_arm/control/unit_watch.hpp"

#include <algorithm>
#include <cstdio>

#include "helix_arm/basics/quote.hpp"

namespace helix_arm::control {

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
    char text[256];
    std::snprintf(text, sizeof text,
                  "all pressures of %s are at most %g Pa, which looks like kPa; pressure_target "
                  "takes gauge pressures in Pa, so 200 kPa are 200000",
                  basics::quoted(commander).c_str(), record.largest);
    return text;
  }
  return {};
}

}  // namespace helix_arm::control
