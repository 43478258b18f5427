#pragma once

#include <Eigen/Core>

#include "box_levenberg_marquardt.hpp"

namespace helix_arm::statics {

/// Continues descents that ended near a target, along a valley of the cost.
///
/// A section that closes to a circle hardly moves its tip when the circle turns about its start: a
/// narrow valley, bent so much that a descent creeps along it. This takes a step as far along the
/// valley as the linear model wants, descends from there, and compares the costs only then.
class InverseValley {
 public:
  /// @param rest_length  of the arm [m]. @param budget  iterations in valleys for one target.
  InverseValley(BoxLevenbergMarquardt& minimiser, int actuators, double rest_length, int budget);

  /// Gives a new target its whole budget.
  void restart() { left_ = budget_; }

  /// @param before  how the descent to the point ended. @return how this one does.
  Descent follow(InversePoint& point, Descent before) noexcept;

 private:
  BoxLevenbergMarquardt& minimiser_;
  double rest_length_;
  int budget_;
  int left_ = 0;  // of the budget
  Eigen::VectorXd tangent_, base_lengths_;
};

}  // namespace helix_arm::statics
