#pragma once

#include <Eigen/Core>

#include "helix_arm/statics/solution.hpp"

namespace helix_arm::statics {

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
