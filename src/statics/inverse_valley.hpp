#pragma once

#include <Eigen/Core>

#include "box_levenberg_marquardt.hpp"

namespace helix_arm::statics {

/// Continues descents that ended near a target, along a valley of the cost.
///
/// A section that closes to a circle hardly moves its tip when the circle turns about its start.
/// This is a narrow valley, so curved that a descent makes little progress along it. This class
/// takes the full step of the linear model along the valley, descends from there, and only then
/// compares the costs.
class InverseValley {
 public:
  /// @param rest_length  of the arm [m]. @param budget  iterations in valleys per target.
  InverseValley(BoxLevenbergMarquardt& minimiser, int actuators, double rest_length, int budget);

  /// Restores the full budget, for a new target.
  void restart() { left_ = budget_; }

  /// @param before  result of the descent to the point. @return result of this descent.
  Descent follow(InversePoint& point, Descent before) noexcept;

 private:
  BoxLevenbergMarquardt& minimiser_;
  double rest_length_;
  int budget_;
  int left_ = 0;  // remaining budget
  Eigen::VectorXd tangent_, base_lengths_;
};

}  // namespace helix_arm::statics
