#pragma once

#include <Eigen/Core>
#include <vector>

namespace helix_arm::model {

/// Maximum number of actuators per section; lets a section's map be stored without heap memory.
inline constexpr int kMaxActuators = 24;

/// The data of one actuator that the equilibrium needs: its pose and stiffness.
template <class Group>
struct ActuatorElement {
  Group X_O;                  ///< pose in the base-curve frame
  typename Group::Tangent K;  ///< diagonal of the normalised stiffness, v first; entries >= 0
};

/// The linear map from actuator lengths to the section's twist (eq. 17), with properties of A.
template <class Group>
struct Equilibrium {
  static constexpr int kDof = Group::kDof;
  using Map = Eigen::Matrix<double, kDof, Eigen::Dynamic, Eigen::ColMajor, kDof, kMaxActuators>;
  using Basis = Eigen::Matrix<double, kDof, Eigen::Dynamic, Eigen::ColMajor, kDof, kDof>;

  Map map;  ///< A+ D (dof x n): twist [m, rad] = map * lengths [m]
  /// A+, symmetric: twist [m, rad] = l * compliance * (wrench / K_eps).
  typename Group::Matrix compliance;
  int rank = 0;      ///< of A
  double condition;  ///< of A, scaled to lengths, on the space where A is not singular
  Basis null_space;  ///< (dof x (dof - rank)) orthonormal twists that cost no energy; the solution
                     ///< has no component along them
};

/// Equilibrium of an unloaded section: minimum-norm solution of A g = D l, A = sum Ad_i^-T K_i
/// Ad_i^-1, D = [Ad_i^-T K_i e1] (eq. 15-17), without forming A.
///
/// The stack of K_i^1/2 Ad_i^-1 is scaled to one unit of length, its rows are sorted by size, and
/// it is factored with column pivoting.
///
/// @param elements  (n) one per actuator, 1 <= n <= kMaxActuators, at least one with stiffness.
/// @throws std::invalid_argument naming the element and the rule it breaks.
template <class Group>
Equilibrium<Group> solveEquilibrium(const std::vector<ActuatorElement<Group>>& elements);

}  // namespace helix_arm::model
