#include "helix_arm/regulator/pressure_path.hpp"

#include <cmath>
#include <utility>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::regulator {
namespace {

constexpr double kJustThen = 2;  // between an error and the fault that it caused [s]

}  // namespace

IoRules ioRulesOf(const control::SafetyRules& rules) {
  IoRules out;
  out.vented_below = rules.vented_below;
  out.vent_time = rules.vent_time;
  return out;
}

PressurePath::PressurePath(control::SafetyCore core, std::unique_ptr<RegulatorIo> io,
                           double longest_gap)
    : core_(std::move(core)),
      reading_(static_cast<int>(core_.channels().size())),
      longest_gap_(longest_gap),
      io_(std::move(io)) {
  basics::requireValue(longest_gap > 0, "pressure path", "the longest gap [s]", longest_gap,
                       "a value > 0");
}

void PressurePath::askGuard(double now) {
  core_.guarded(now, guard_ ? guard_->state() : control::Guard::kNotNeeded);
}

const control::ValveOrders& PressurePath::turn(double now) {
  fresh_ = false;
  askGuard(now);
  if (now - last_turn_ > longest_gap_) {
    core_.linked(now, false);
    core_.linked(now, true);
  }
  last_turn_ = now;
  if (io_) {
    // A link that dropped and came back between two turns counts as dropped.
    const std::uint64_t breaks = io_->breaks();
    if (breaks != breaks_seen_) core_.linked(now, false);
    breaks_seen_ = breaks;
    core_.linked(now, io_->up());
    fresh_ = io_->take(reading_);
    // A reading that was delayed, or that waited for a late turn, does not describe the present.
    const double age = now - reading_.time;
    if (fresh_ && age <= core_.rules().reading_timeout) {
      core_.measured(now, reading_.pressures.pressure, reading_.pressures.supply, age);
    }
  }
  const control::ValveOrders& orders = core_.advance(now);
  if (io_) io_->order(orders, breaks_seen_);
  return orders;
}

bool PressurePath::target(double now, const Eigen::Ref<const Eigen::VectorXd>& pressure) {
  fresh_ = false;
  const bool taken = core_.target(now, pressure);
  if (taken) turn(now);
  return taken;
}

control::SafetyText PressurePath::text() const {
  control::SafetyText out = core_.text();
  if (!io_) return out;
  const IoStatus line = io_->status();
  const control::SafetyReport& report = core_.report();
  const bool of_line = report.cause == control::SafetyCause::kRegulatorLost ||
                       report.cause == control::SafetyCause::kStaleReading;
  const bool just_then = std::abs(line.last_error_time - report.since) < kJustThen;
  if (!line.last_error.empty() && (!line.up || (of_line && just_then))) {
    std::string& last = !out.remedy.empty()   ? out.remedy
                        : !out.action.empty() ? out.action
                                              : out.problem;
    last += " (" + line.last_error + ")";
  }
  return out;
}

std::string PressurePath::enable(double now) {
  askGuard(now);
  std::string refusal = core_.enable(now);
  if (refusal.empty() || !io_) return refusal;
  const IoStatus line = io_->status();
  if (line.last_error_time > line.last_read_time) refusal += " (" + line.last_error + ")";
  return refusal;
}

}  // namespace helix_arm::regulator
