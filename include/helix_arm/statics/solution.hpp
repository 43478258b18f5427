#pragma once

#include <Eigen/Core>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/shape.hpp"

namespace helix_arm::statics {

enum class SolveStatus {
  kConverged,     ///< loaded tier: the tip error is within statedTipError() of its order
  kNotConverged,  ///< the last iterate is returned; it does not balance the load, is unstable, or
                  ///< errs by more than statedTipError() of its order
  kSnapped,  ///< exact tier: in balance and stable, but the branch of shapes that grows from the
             ///< unloaded one ends at a smaller load, so the arm may snap to another shape
  kUnsupported,  ///< the load acts along a motion that no actuator resists, so there is no
                 ///< equilibrium
};
/// "converged", "not_converged", "snapped" or "unsupported".
const char* nameOf(SolveStatus status);

/// Tip of an arm as computed by one of the tiers.
template <class Group>
struct TipOf {
  Group tip;  ///< seen from the base
  SolveStatus status = SolveStatus::kConverged;
  /// Size of the last iteration's step, relative to the arm's size. If an order is rejected for its
  /// error, that error.
  double residual = 0.0;
  int iterations = 0;  ///< 0 for closed-form solutions
  /// Load steps along the branch that grows from the unloaded shape; 0 if there can be no other.
  int load_steps = 0;

  bool converged() const { return status == SolveStatus::kConverged; }
};
using Tip = TipOf<lie::SE3>;

/// The same, embedded in space.
template <class Group>
Tip inSpace(const TipOf<Group>& found) {
  return {lie::inSpace(found.tip), found.status, found.residual, found.iterations,
          found.load_steps};
}

/// The tip with the shape of the arm.
struct Solution : Tip {
  model::Shape shape;
};

/// A tip and its derivatives. The status also covers the nearby tips of differences.
template <class Group>
struct TipResponseOf : TipOf<Group> {
  /// (dof x m) body twist of the tip per unit of each of m changes; NaN unless it converged.
  Eigen::Matrix<double, Group::kDof, Eigen::Dynamic> by;
};
using TipResponse = TipResponseOf<lie::SE3>;

/// Derivatives of tip and twists with respect to m quantities.
struct ShapeDerivative {
  /// (6 x m) motion of the tip: its velocity and its angular velocity, base frame [m; rad].
  Eigen::Matrix<double, 6, Eigen::Dynamic> tip;
  /// (6 sections x m) mean twists of the sections, v [m], w [rad].
  Eigen::MatrixXd twists;
};

/// A shape and its derivatives, NaN unless it converged.
struct ShapeResponse {
  Solution at;
  ShapeDerivative by;
};

}  // namespace helix_arm::statics
