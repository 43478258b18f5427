#pragma once

#include <Eigen/Core>
#include <optional>

#include "box_levenberg_marquardt.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "inverse_starts.hpp"
#include "inverse_task.hpp"
#include "length_box.hpp"
#include "tip_stiffness.hpp"

namespace helix_arm::statics {

/// Optimises the preference among inputs that reach a target, for arms with redundant actuators:
/// moves along those inputs to a local minimum of sum_i ((q_i - q_ref,i) / range_i)^2 or, for
/// kStiff, to the lowest minimum of the tip's compliance among those of several starts.
///
/// Keeps references to arm, box, minimiser, starts and task. All memory is allocated in the
/// constructor, except by kStiff.
class InversePreference {
 public:
  InversePreference(const model::Arm& arm, const InverseOptions& options, const LengthBox& box,
                    BoxLevenbergMarquardt& minimiser, InverseStarts& starts,
                    const InverseTask& task, const ArmModel* model);

  /// Sets q_ref for a solution that starts at inputs `start` (n).
  void prefer(const model::InputRef& start) noexcept;

  /// @param point  evaluated point that reaches the target; modified.
  /// @param input  inputs (n) of the point; modified.
  /// @return the number of steps taken, at most max_iterations from each start.
  int follow(InversePoint& point, Eigen::VectorXd& input) noexcept;

 private:
  double cost(const Eigen::VectorXd& input) const noexcept;
  // Of kStiff: logarithm of the compliance at inputs, and its gradient by the fractions of their
  // ranges.
  double softness(const Eigen::VectorXd& input) const noexcept;
  double softnessGradient(const Eigen::VectorXd& input) noexcept;
  bool improve(InversePoint& point, Eigen::VectorXd& input) noexcept;
  int settle(InversePoint& point, Eigen::VectorXd& input) noexcept;
  int searchElsewhere(InversePoint& point, Eigen::VectorXd& input) noexcept;
  // Difference of an input from its reference, divided by its range.
  double offset(int i, double input) const;

  const model::Arm& arm_;
  const InverseOptions options_;
  const LengthBox& box_;
  BoxLevenbergMarquardt& minimiser_;
  InverseStarts& starts_;
  const InverseTask& task_;
  int n_;
  std::optional<TipStiffness> stiffness_;  // for kStiff
  Eigen::VectorXd reference_;              // q_ref
  Eigen::VectorXd slope_;                  // d((q - q_ref) / range) / dl
  Eigen::VectorXd diagonal_, gradient_;    // of the weighted preference
  Eigen::VectorXd by_fraction_;            // gradient of the softness
  Eigen::VectorXd tangent_, base_lengths_, base_input_;
};

}  // namespace helix_arm::statics
