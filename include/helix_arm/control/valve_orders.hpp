#pragma once

#include <Eigen/Core>
#include <vector>

namespace helix_arm::control {

/// Order for one channel of a pressure regulator.
enum class Valve : unsigned char {
  kVent,      ///< release the pressure to the atmosphere
  kRegulate,  ///< control the pressure to the set point
  kClose,     ///< neither feed nor vent
};

/// Orders for all channels, in the order of the arm's actuators. Initially all channels vent.
struct ValveOrders {
  explicit ValveOrders(int channels)
      : valve(static_cast<std::size_t>(channels), Valve::kVent),
        set_point(Eigen::VectorXd::Zero(channels)) {}

  std::vector<Valve> valve;   ///< (channels)
  Eigen::VectorXd set_point;  ///< (channels) gauge [Pa]; 0 for channels that vent
};

}  // namespace helix_arm::control
