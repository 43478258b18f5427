#pragma once

#include <vector>

#include "helix_arm/statics/shape_derivative.hpp"
#include "wrench.hpp"

/// Motions of an arm's places: twists about the base's origin, seen from the base, one per column.
namespace helix_arm::statics {

using Motions = Eigen::Matrix<double, 6, Eigen::Dynamic>;

inline Motions motionsInSpace(const Motions& motions) { return motions; }
inline Motions motionsInSpace(const Eigen::Matrix<double, 3, Eigen::Dynamic>& motions) {
  Motions out(6, motions.cols());
  for (int i = 0; i < motions.cols(); ++i) {
    out.col(i) = lie::embed(lie::SE2::Tangent(motions.col(i)));
  }
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

}  // namespace helix_arm::statics
