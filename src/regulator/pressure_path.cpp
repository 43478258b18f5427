#include "helix_arm/regulator/pressure_path.hpp"

#include <utility>

#include "helix_arm/model/requirement.hpp"

namespace helix_arm::regulator {

PressurePath::PressurePath(control::SafetyCore core, std::unique_ptr<RegulatorIo> io,
                           double longest_gap)
    : core_(std::move(core)),
      reading_(static_cast<int>(core_.channels().size())),
      longest_gap_(longest_gap),
      io_(std::move(io)) {
  model::requireValue(longest_gap > 0, "pressure path", "the longest gap [s]", longest_gap,
                      "a value > 0");
}

const control::ValveOrders& PressurePath::turn(double now) {
  fresh_ = false;
  if (now - last_turn_ > longest_gap_) {
    core_.linked(now, false);
    core_.linked(now, true);
  }
  last_turn_ = now;
  if (io_) {
    // A link that dropped and came back between two turns has dropped all the same.
    const std::uint64_t breaks = io_->breaks();
    if (breaks != breaks_seen_) core_.linked(now, false);
    breaks_seen_ = breaks;
    core_.linked(now, io_->up());
    fresh_ = io_->take(reading_);
    // One that was long on its way, or waited for a turn that did not come, tells nothing of now.
    const bool of_now = fresh_ && now - reading_.time <= core_.rules().reading_timeout;
    if (of_now) core_.measured(now, reading_.pressures.pressure, reading_.pressures.supply);
  }
  const control::ValveOrders& orders = core_.advance(now);
  if (io_) io_->order(orders, breaks_seen_);
  return orders;
}

bool PressurePath::target(double now, const Eigen::Ref<const Eigen::VectorXd>& pressure) {
  const bool taken = core_.target(now, pressure);
  if (taken) turn(now);
  return taken;
}

}  // namespace helix_arm::regulator
