#pragma once

namespace helix_arm::basics {

inline constexpr double kPi = 3.14159265358979323846;  ///< half a turn [rad]

}  // namespace helix_arm::basics
