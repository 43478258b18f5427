#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/statics/arm_model.hpp"
#include "inverse_task.hpp"
#include "length_box.hpp"

namespace helix_arm::statics {

/// Additional starts of the inverse: lengths sampled within the limits, and the corners of the
/// limits for arms with few actuators. All memory is allocated in the constructor.
class InverseStarts {
 public:
  /// @param loaded  model of the arm if a load bends it, else null.
  InverseStarts(const model::Arm& arm, const ArmModel* loaded, const LengthBox& box);

  /// Lengths (n) [m] of start `number` of a task, counted from 0. The order is: the starts whose
  /// tips are nearest to the target, the nearest corners, then samples spread over all starts. Call
  /// it with consecutive numbers within one task.
  Eigen::MatrixXd::ConstColXpr next(int number, const InverseTask& task) noexcept;

 private:
  int nearest(int count, const InverseTask& task) const noexcept;

  Eigen::MatrixXd lengths_;  // (n x starts) [m], the corners first
  int corners_ = 0;
  std::vector<lie::SE3> tips_;
  std::vector<char> used_;
};

}  // namespace helix_arm::statics
