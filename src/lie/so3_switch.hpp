#pragma once

namespace helix_arm::lie {

/// Angle [rad] above which exp of a rotation divides by it. Below, the quotient's limit is exact.
inline constexpr double kSo3ExpSwitch = 1e-8;

/// Norm of the quaternion's vector part above which log of a rotation divides by it. As above.
inline constexpr double kSo3LogSwitch = 1e-8;

}  // namespace helix_arm::lie
