#include "helix_arm/regulator/pressure_path.hpp"

#include <utility>

namespace helix_arm::regulator {

PressurePath::PressurePath(control::SafetyCore core, std::unique_ptr<RegulatorIo> io)
    : core_(std::move(core)),
      reading_(static_cast<int>(core_.channels().size())),
      io_(std::move(io)) {}

const control::ValveOrders& PressurePath::turn(double now) {
  fresh_ = false;
  if (io_) {
    // A link that dropped and came back between two turns has dropped all the same: the device may
    // have restarted.
    const std::uint64_t drops = io_->drops();
    if (drops != drops_seen_) core_.linked(now, false);
    drops_seen_ = drops;
    core_.linked(now, io_->up());
    fresh_ = io_->take(reading_);
    if (fresh_) core_.measured(now, reading_.pressures.pressure, reading_.pressures.supply);
  }
  const control::ValveOrders& orders = core_.advance(now);
  if (io_) io_->order(orders, drops_seen_);
  return orders;
}

bool PressurePath::target(double now, const Eigen::Ref<const Eigen::VectorXd>& pressure) {
  const bool taken = core_.target(now, pressure);
  if (taken) turn(now);
  return taken;
}

}  // namespace helix_arm::regulator
