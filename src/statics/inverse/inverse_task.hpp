#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <vector>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/correction.hpp"

namespace helix_arm::statics {

/// Range of the actuators' lengths [m] within the limits of their inputs, one interval per
/// actuator; at first those of the arm. Keeps a reference to the arm.
class LengthBox {
 public:
  explicit LengthBox(const model::Arm& arm);

  /// Narrows the limits of the inputs to lower .. upper (n), which are within the arm's.
  void limit(const model::InputRef& lower, const model::InputRef& upper) noexcept;
  /// Limits of an input.
  const model::Range& limits(int i) const { return limits_[static_cast<std::size_t>(i)]; }

  int size() const { return static_cast<int>(lower_.size()); }
  /// (n) [m]
  const Eigen::VectorXd& lower() const { return lower_; }
  const Eigen::VectorXd& upper() const { return upper_; }

  /// Inputs (n) that give lengths (n) [m] inside the box.
  /// @param input  initial guesses, replaced by the result.
  void readInputs(const Eigen::VectorXd& lengths, Eigen::VectorXd& input) const noexcept;

 private:
  const model::Arm& arm_;
  std::vector<model::Range> limits_;
  Eigen::VectorXd at_lower_limit_, at_upper_limit_;  // lengths at the limits of the inputs [m]
  Eigen::VectorXd lower_, upper_;                    // of the lengths [m]
};

/// Residual if no shape balances the load: larger than that of any target [m].
inline constexpr double kNoBalance = 1e9;

/// The function whose root the inverse seeks: the weighted error of a target as a function of the
/// actuators' lengths.
class InverseTask {
 public:
  enum class Kind { kPosition, kPose, kTwists };

  /// Keeps a reference to the model.
  InverseTask(const CorrectedModel& corrected, double rotation_weight);

  void setPosition(const Eigen::Vector3d& position);
  void setPose(const lie::SE3& pose);
  void setTwists(const model::Twists& twists);

  Kind kind() const { return kind_; }
  /// Position of the desired tip [m].
  const Eigen::Vector3d& position() const { return pose_.translation; }
  /// Rows of the residual: 3, 6, or 6 per section.
  int rows() const { return rows_; }
  int maxRows() const { return 6 * model_.arm().sectionCount(); }
  /// Whether the arm has more actuators than the target requires.
  bool hasSpareActuators() const { return actuators_ > std::min(rows_, map_rank_); }

  /// Residual (rows) [m] at lengths (n) [m], and its Jacobian (rows x n), unitless. Every row is
  /// kNoBalance if no shape balances the load.
  /// @throws std::bad_alloc only if a load bends the arm: its solution allocates. The search that
  ///     called it then ends, and its solver takes the next target.
  void evaluate(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                Eigen::MatrixXd& jacobian) const;

  /// Distance between the tip at these lengths and the desired tip [m].
  double positionError(const Eigen::VectorXd& lengths) const;

  /// Squared residual of a given tip [m^2], for position and pose targets.
  double squaredErrorOfTip(const lie::SE3& tip) const noexcept;

 private:
  void evaluateSingleSection(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                             Eigen::MatrixXd& jacobian) const noexcept;
  // False, with any values, if no shape balances the load.
  bool evaluateTip(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                   Eigen::MatrixXd& jacobian) const;
  bool evaluateTwists(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                      Eigen::MatrixXd& jacobian) const;

  const CorrectedModel& model_;
  double rotation_weight_;
  int actuators_;
  bool single_;       // one section of constant twist and no link
  int map_rank_ = 0;  // number of independent motions of all sections together
  Kind kind_ = Kind::kPosition;
  int rows_ = 3;
  lie::SE3 pose_;  // pose of the desired tip, for targets of every kind
  model::Twists twists_;
  mutable Eigen::MatrixXd tip_by_lengths_;
};

/// Additional starts of the inverse: lengths sampled within the limits, and the corners of the
/// limits for arms with few actuators. All memory is allocated in the constructor.
class InverseStarts {
 public:
  InverseStarts(const ArmModel& model, const LengthBox& box);

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
