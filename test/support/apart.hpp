#pragma once

#include "helix_arm/lie/se3.hpp"

namespace helix_arm::test {

/// Distance of two poses: of their places [m] and of their rotation matrices.
inline double apart(const lie::SE3& a, const lie::SE3& b) {
  return (a.translation - b.translation).norm() + (a.rotation - b.rotation).norm();
}

}  // namespace helix_arm::test
