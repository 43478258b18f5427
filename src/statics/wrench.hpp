#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "helix_arm/lie/se2.hpp"
#include "helix_arm/lie/se3.hpp"

/// Wrenches in space and in the plane. A wrench is [force; moment about the origin].
namespace helix_arm::statics {

/// Moment: three components in space, one in the plane.
template <class Group>
using Moment = Eigen::Matrix<double, Group::kRotations, 1>;

/// Moment about the origin of a force at p.
inline Eigen::Vector3d momentOf(const Eigen::Vector3d& p, const Eigen::Vector3d& force) {
  return p.cross(force);
}
inline Moment<lie::SE2> momentOf(const Eigen::Vector2d& p, const Eigen::Vector2d& force) {
  return Moment<lie::SE2>(p.x() * force.y() - p.y() * force.x());
}

/// Components of a spatial vector within the group's space.
template <class Group>
typename Group::Point within(const Eigen::Vector3d& v) {
  return v.head<Group::kSpace>();
}
/// Components of a spatial moment that rotate within the group's space.
template <class Group>
Moment<Group> turningWithin(const Eigen::Vector3d& moment) {
  return moment.tail<Group::kRotations>();
}

/// Ad_X xi, without forming the matrix.
inline lie::Vector6 moved(const lie::SE3& X, const lie::Vector6& xi) {
  lie::Vector6 out;
  out.tail<3>() = X.rotation * xi.tail<3>();
  out.head<3>() = X.rotation * xi.head<3>() + X.translation.cross(out.tail<3>());
  return out;
}
inline lie::SE2::Tangent moved(const lie::SE2& X, const lie::SE2::Tangent& xi) {
  lie::SE2::Tangent out;
  out.head<2>() =
      X.rotation * xi.head<2>() + xi[2] * Eigen::Vector2d(X.translation.y(), -X.translation.x());
  out[2] = xi[2];
  return out;
}

/// Ad_X^T W, without forming the matrix: the wrench seen from frame X.
template <class Group>
typename Group::Tangent seenFrom(const Group& X, const typename Group::Tangent& W) {
  constexpr int kSpace = Group::kSpace, kRotations = Group::kRotations;
  const typename Group::Point force = W.template head<kSpace>();
  const Moment<Group> moment = W.template tail<kRotations>() - momentOf(X.translation, force);
  typename Group::Tangent out;
  out.template head<kSpace>() = X.rotation.transpose() * force;
  if constexpr (kRotations == kSpace) {
    out.template tail<kRotations>() = X.rotation.transpose() * moment;
  } else {
    out.template tail<kRotations>() = moment;
  }
  return out;
}

}  // namespace helix_arm::statics
