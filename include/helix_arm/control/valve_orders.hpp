#pragma once

#include <Eigen/Core>
#include <vector>

namespace helix_arm::control {

/// What one channel of a pressure regulator is to do.
enum class Valve : unsigned char {
  kVent,      ///< let the pressure out, to the atmosphere
  kRegulate,  ///< keep the set point
  kClose,     ///< neither feed nor vent
};

/// What all channels are to do, in the order of the arm's actuators. Vented unless told otherwise.
struct ValveOrders {
  explicit ValveOrders(int channels)
      : valve(static_cast<std::size_t>(channels), Valve::kVent),
        set_point(Eigen::VectorXd::Zero(channels)) {}

  std::vector<Valve> valve;   ///< (channels)
  Eigen::VectorXd set_point;  ///< (channels) gauge [Pa]; 0 where it vents
};

}  // namespace helix_arm::control
