#pragma once

#include <Eigen/Core>

#include "box_levenberg_marquardt.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "length_box.hpp"

namespace helix_arm::statics {

/// The preference among inputs that reach a target, for arms with actuators to spare: moves along
/// those inputs to the least sum_i ((q_i - q_ref,i) / range_i)^2 nearby.
///
/// Keeps references to arm, box and minimiser. All memory is taken in the constructor.
class InversePreference {
 public:
  InversePreference(const model::Arm& arm, const InverseOptions& options, const LengthBox& box,
                    BoxLevenbergMarquardt& minimiser);

  /// Sets q_ref for a solution that starts at these inputs (n).
  void prefer(const model::InputRef& start) noexcept;

  /// @param point  evaluated, reaches the target. @param input  its inputs (n). Both are moved.
  /// @return the number of steps that were taken, at most max_iterations.
  int follow(InversePoint& point, Eigen::VectorXd& input) noexcept;

 private:
  double cost(const Eigen::VectorXd& input) const noexcept;
  bool improve(InversePoint& point, Eigen::VectorXd& input) noexcept;
  // Difference of an input from its reference, by its range.
  double offset(int i, double input) const;

  const model::Arm& arm_;
  const InverseOptions options_;
  const LengthBox& box_;
  BoxLevenbergMarquardt& minimiser_;
  int n_;
  Eigen::VectorXd reference_;            // q_ref
  Eigen::VectorXd slope_;                // d((q - q_ref) / range) / dl
  Eigen::VectorXd diagonal_, gradient_;  // of the weighted preference
  Eigen::VectorXd tangent_, base_lengths_, base_input_;
};

}  // namespace helix_arm::statics
