#pragma once

#include <Eigen/Core>

#include "box_levenberg_marquardt.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "length_box.hpp"

namespace helix_arm::statics {

/// Optimises the preference among inputs that reach a target, for arms with redundant actuators:
/// moves along those inputs to a local minimum of sum_i ((q_i - q_ref,i) / range_i)^2.
///
/// Keeps references to arm, box and minimiser. All memory is allocated in the constructor.
class InversePreference {
 public:
  InversePreference(const model::Arm& arm, const InverseOptions& options, const LengthBox& box,
                    BoxLevenbergMarquardt& minimiser);

  /// Sets q_ref for a solution that starts at inputs `start` (n).
  void prefer(const model::InputRef& start) noexcept;

  /// @param point  evaluated point that reaches the target; modified.
  /// @param input  inputs (n) of the point; modified.
  /// @return the number of steps taken, at most max_iterations.
  int follow(InversePoint& point, Eigen::VectorXd& input) noexcept;

 private:
  double cost(const Eigen::VectorXd& input) const noexcept;
  bool improve(InversePoint& point, Eigen::VectorXd& input) noexcept;
  // Difference of an input from its reference, divided by its range.
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
