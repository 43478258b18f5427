#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/statics/arm_model.hpp"
#include "inverse_task.hpp"
#include "length_box.hpp"

namespace helix_arm::statics {

/// Further starts of the inverse: lengths sampled within the limits, and the corners of the limits
/// of arms with few actuators. All memory is taken in the constructor.
class InverseStarts {
 public:
  /// @param loaded  the arm's model where a load bends it, else null.
  InverseStarts(const model::Arm& arm, const ArmModel* loaded, const LengthBox& box);

  /// Lengths (n) [m] of start `number` of a task, counted from 0: first those with their tips
  /// nearest to the target, then the nearest corners, then samples spread over all.
  /// Numbers of one task come in their order.
  Eigen::MatrixXd::ConstColXpr next(int number, const InverseTask& task) noexcept;

 private:
  int nearest(int count, const InverseTask& task) const noexcept;

  Eigen::MatrixXd lengths_;  // (n x starts) [m], the corners first
  int corners_ = 0;
  std::vector<lie::SE3> tips_;
  std::vector<char> used_;
};

}  // namespace helix_arm::statics
