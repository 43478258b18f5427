#pragma once

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/shape.hpp"

namespace helix_arm::statics {

enum class SolveStatus {
  kConverged,     ///< of the loaded tier: the tip is within statedTipError() of its order
  kNotConverged,  ///< the last iterate is given; it does not balance the load, does not hold, or is
                  ///< off by more than statedTipError() of its order
  kUnsupported,   ///< the load pulls along a motion that no actuator resists: no shape holds it
};
/// "converged", "not_converged" or "unsupported".
const char* nameOf(SolveStatus status);

/// Shape of an arm as one of the tiers finds it.
struct Solution {
  model::Shape shape;
  lie::SE3 tip;  ///< seen from the base
  SolveStatus status = SolveStatus::kConverged;
  /// What the last iteration still moved, relative to the arm's size; where an order is refused for
  /// its error, that error.
  double residual = 0.0;
  int iterations = 0;  ///< 0 where the answer is in closed form

  bool converged() const { return status == SolveStatus::kConverged; }
};

/// The tip alone.
template <class Group>
struct TipOf {
  Group tip;  ///< seen from the base
  SolveStatus status = SolveStatus::kConverged;
  double residual = 0.0;
  int iterations = 0;

  bool converged() const { return status == SolveStatus::kConverged; }
};
using Tip = TipOf<lie::SE3>;

/// Tip of an arm, and how it moves.
struct TipResponse {
  lie::SE3 tip;  ///< seen from the base
  SolveStatus status = SolveStatus::kConverged;
  /// (6 x n) its body twist by the free length of each actuator [m/m; rad/m].
  Eigen::Matrix<double, 6, Eigen::Dynamic> by_lengths;
};

}  // namespace helix_arm::statics
