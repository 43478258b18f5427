#pragma once

#include <Eigen/Core>
#include <optional>

#include "helix_arm/statics/arm_model.hpp"

namespace helix_arm::statics {

/// Derivatives of tip and twists with respect to m quantities.
struct ShapeDerivative {
  /// (6 x m) motion of the tip: its velocity and its angular velocity, base frame [m; rad].
  Eigen::Matrix<double, 6, Eigen::Dynamic> tip;
  /// (6 sections x m) mean twists of the sections, v [m], w [rad].
  Eigen::MatrixXd twists;
};

/// Tip and twists of an arm, and their derivatives.
struct ShapeJacobian {
  SolveStatus status = SolveStatus::kConverged;
  lie::SE3 tip;  ///< seen from the base
  model::Twists twists;
  ShapeDerivative by_inputs;   ///< m = n: per input [1/Pa or 1/rad]
  ShapeDerivative by_lengths;  ///< m = n: per free length [1/m]
  /// m = 3 n: per K_gamma [1], K_tau [1/m^2] and K_kappa [1/m^2] of actuator 0, then of actuator 1
  /// and so on. NaN where an entry of 0 resists a motion that nothing else resists: the shape
  /// jumps there.
  ShapeDerivative by_stiffness;
  /// m = 6: per dead force (3) [1/N] and moment (3) [1/(N m)] at the tip, base frame. Absent
  /// without K_eps of the arm.
  std::optional<ShapeDerivative> by_load;
};

/// Derivatives at inputs q (n).
///
/// Without load they are analytic; that with respect to a load is the integral of the sections'
/// compliances along the curve. Under load, or of a tapered arm, they are differences of fourth
/// order of the model's own solutions, within 1e-6 of the largest column.
/// @throws as Arm::lengths() does. The derivatives are NaN unless all solutions converged.
ShapeJacobian jacobianAt(const ArmModel& model, const model::InputRef& q);

}  // namespace helix_arm::statics
