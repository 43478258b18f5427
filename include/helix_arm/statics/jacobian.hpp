#pragma once

#include <Eigen/Core>
#include <optional>

#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/solution.hpp"

namespace helix_arm::statics {

/// Derivatives that jacobianAt() computes beside those by inputs and lengths.
struct JacobianParts {
  bool by_stiffness = true;
  bool by_load = true;
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
  /// jumps there. Absent unless wanted.
  std::optional<ShapeDerivative> by_stiffness;
  /// m = 6: per dead force (3) [1/N] and moment (3) [1/(N m)] at the tip, base frame. Absent
  /// unless wanted, and without K_eps of the arm. In the tiers that take no load, at the shape
  /// without load, with the StiffnessTables of Load.
  std::optional<ShapeDerivative> by_load;
};

/// Derivatives at inputs q (n), analytic. Under load they follow from the implicit function theorem
/// at the tier's own equilibrium.
/// @param wanted  What is left out takes no time. In the tiers that take no load, the other
///     derivatives do not depend on it, and only those by load may fail to converge; under load
///     they do by rounding.
/// @throws as Arm::lengths() does, and as requireTables() where the tables of stiffness are used:
/// under load, and for the derivatives by load. The derivatives are NaN unless the solution
/// converged.
ShapeJacobian jacobianAt(const ArmModel& model, const model::InputRef& q,
                         const JacobianParts& wanted = {});

}  // namespace helix_arm::statics
