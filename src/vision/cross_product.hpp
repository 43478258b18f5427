#pragma once

#include <Eigen/Core>

namespace helix_arm::vision {

/// z component of the cross product of two image vectors.
inline double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

}  // namespace helix_arm::vision
