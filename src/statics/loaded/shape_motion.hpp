#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "helix_arm/lie/se2.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/solution.hpp"

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

// Motions of an arm's places: twists about the base's origin, seen from the base, one per column.

using Motions = Eigen::Matrix<double, 6, Eigen::Dynamic>;

/// Motions in the plane or in space, embedded in space.
template <class Derived>
Motions motionsInSpace(const Eigen::MatrixBase<Derived>& motions) {
  using Twist = Eigen::Matrix<double, Derived::RowsAtCompileTime, 1>;
  Motions out(6, motions.cols());
  for (int i = 0; i < motions.cols(); ++i) out.col(i) = lie::inSpace(Twist(motions.col(i)));
  return out;
}

/// Velocity and angular velocity of a tip, base frame, by its motions.
Motions velocitiesOf(const lie::SE3& tip, const Motions& motions);

/// Derivative of a shape by the motions of the ends of its pieces.
ShapeDerivative shapeDerivative(const model::Shape& shape, const std::vector<Motions>& ends);

/// All entries are `value`.
ShapeDerivative constantDerivative(int sections, int columns, double value);

/// A shape that balances no load, with derivatives that are NaN.
ShapeResponse withoutDerivative(Solution at, int columns);

/// Derivatives (dof x parameters [+ 6]) of the wrench beyond a tip at p: 0 by the parameters, then
/// on request by a dead force (3) and a dead moment (3) there.
template <class Group>
Eigen::Matrix<double, Group::kDof, Eigen::Dynamic> wrenchesAt(const typename Group::Point& p,
                                                              int parameters, bool by_load) {
  Eigen::Matrix<double, Group::kDof, Eigen::Dynamic> out =
      Eigen::Matrix<double, Group::kDof, Eigen::Dynamic>::Zero(Group::kDof,
                                                               parameters + (by_load ? 6 : 0));
  for (int axis = 0; by_load && axis < 3; ++axis) {
    const Eigen::Vector3d unit = Eigen::Vector3d::Unit(axis);
    const typename Group::Point force = within<Group>(unit);
    out.col(parameters + axis).template head<Group::kSpace>() = force;
    out.col(parameters + axis).template tail<Group::kRotations>() = momentOf(p, force);
    out.col(parameters + 3 + axis).template tail<Group::kRotations>() = turningWithin<Group>(unit);
  }
  return out;
}

/// The twist whose exp is X and whose rotation vector is nearest to `near` [rad], beyond pi, too.
lie::Vector6 twistNear(const lie::SE3& X, const Eigen::Vector3d& near);

/// Body motion of the tip with respect to the free length of each actuator, without load. Calls
/// take(i, motion) for every actuator i, motion (dof) [m/m; rad/m].
/// @param unloaded  state of the arm.
template <class Group, class Take>
void forTipMotionsOfPieces(const model::ArmOf<Group>& arm, const model::UnloadedOf<Group>& unloaded,
                           const Take& take) {
  const model::PiecesOf<Group> pieces = arm.pieces(unloaded);
  const int per_section = arm.piecesPerSection();
  Group after;
  for (int k = arm.sectionCount() - 1; k >= 0; --k) {
    after = arm.link(k) * after;
    typename model::Equilibrium<Group>::Map motions = arm.equilibrium(k).map;
    motions.setZero();
    for (int j = per_section - 1; j >= 0; --j) {
      const typename Group::Tangent piece = pieces.col(k * per_section + j);
      const typename Group::Matrix body = after.inverse().adjoint() * Group::rightJacobian(piece);
      motions += body * arm.pieceByLengths(k, j, unloaded);
      after = Group::exp(piece) * after;
    }
    for (int i = 0; i < motions.cols(); ++i) {
      take(arm.firstActuator(k) + i, typename Group::Tangent(motions.col(i)));
    }
  }
}

/// The same for a linear arm.
/// @param twists  (dof x sections).
template <class Group, class Take>
void forTipMotions(const model::ArmOf<Group>& arm, const model::TwistsOf<Group>& twists,
                   const Take& take) {
  // A change of section k's twist moves the tip by Ad(X_link,k X_{k+1} .. X_n)^-1 Jr(g_k).
  Group after;
  const auto& links = arm.links();
  for (int k = arm.sectionCount() - 1; k >= 0; --k) {
    if (links) after = (*links)[k] * after;
    const typename Group::Matrix body =
        after.inverse().adjoint() * Group::rightJacobian(twists.col(k));
    const auto& map = arm.equilibrium(k).map;
    for (int i = 0; i < map.cols(); ++i) {
      take(arm.firstActuator(k) + i, typename Group::Tangent(body * map.col(i)));
    }
    after = Group::exp(twists.col(k)) * after;
  }
}

}  // namespace helix_arm::statics
