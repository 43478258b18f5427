#include "poses.hpp"

#include <Eigen/Geometry>
#include <limits>

namespace helix_arm::python {

Eigen::Vector4d quaternionXyzw(const Eigen::Matrix3d& rotation) {
  const Eigen::Quaterniond q = Eigen::Quaterniond(rotation).normalized();
  return q.w() < 0 ? Eigen::Vector4d(-q.coeffs()) : Eigen::Vector4d(q.coeffs());
}

void setPose(const lie::SE3& pose, bool found, double* position, double* quaternion) {
  constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();
  Eigen::Vector3d::Map(position) = found ? pose.translation : Eigen::Vector3d::Constant(kNoNumber);
  Eigen::Vector4d::Map(quaternion) =
      found ? quaternionXyzw(pose.rotation) : Eigen::Vector4d::Constant(kNoNumber);
}

}  // namespace helix_arm::python
