#pragma once

#include <Eigen/Core>
#include <Eigen/QR>
#include <algorithm>
#include <limits>
#include <random>
#include <vector>

#include "basics/fraction.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/correction.hpp"
#include "helix_arm/statics/inverse.hpp"

namespace helix_arm::statics {

/// Range of the actuators' lengths [m] within the limits of their inputs, one interval per
/// actuator; at first those of the arm. Keeps a reference to the arm.
class LengthBox {
 public:
  explicit LengthBox(const model::Arm& arm)
      : arm_(arm), limits_(static_cast<std::size_t>(arm.actuatorCount())) {
    Eigen::VectorXd lower(arm.actuatorCount()), upper(arm.actuatorCount());
    for (int i = 0; i < arm.actuatorCount(); ++i) {
      lower[i] = arm.actuator(i).limits.lower;
      upper[i] = arm.actuator(i).limits.upper;
    }
    limit(lower, upper);
  }

  /// Narrows the limits of the inputs to lower .. upper (n), which are within the arm's.
  void limit(const model::InputRef& lower, const model::InputRef& upper) {
    at_lower_limit_.resize(lower.size());
    at_upper_limit_.resize(upper.size());
    for (int i = 0; i < arm_.actuatorCount(); ++i) {
      const model::Contraction& contraction = arm_.actuator(i).contraction;
      limits_[static_cast<std::size_t>(i)] = {lower[i], upper[i]};
      at_lower_limit_[i] = contraction.lengthInside(lower[i]);
      at_upper_limit_[i] = contraction.lengthInside(upper[i]);
    }
    lower_ = at_lower_limit_.cwiseMin(at_upper_limit_);
    upper_ = at_lower_limit_.cwiseMax(at_upper_limit_);
  }
  /// Limits of an input.
  const model::Range& limits(int i) const { return limits_[static_cast<std::size_t>(i)]; }

  int size() const { return static_cast<int>(lower_.size()); }
  /// (n) [m]
  const Eigen::VectorXd& lower() const { return lower_; }
  const Eigen::VectorXd& upper() const { return upper_; }

  /// Whether a least-squares cost would fall, by kHeld of it at least, if length i could go beyond
  /// its bound.
  /// @param column  derivative of the residual by it.
  template <class Column, class Residual>
  bool holds(int i, double length, const Column& column, const Residual& residual,
             double cost) const {
    constexpr double kHeld = 1e-3;
    const double slope = column.dot(residual);
    const bool outwards = (length <= lower_[i] && slope > 0) || (length >= upper_[i] && slope < 0);
    return outwards && slope * slope > kHeld * column.squaredNorm() * cost;
  }
  /// The limit of input i that is nearer to q.
  Limit nearestLimit(int i, double q) const {
    return q - limits(i).lower < limits(i).upper - q ? Limit::kLower : Limit::kUpper;
  }

  /// Inputs (n) that give lengths (n) [m] inside the box.
  /// @param input  initial guesses, replaced by the result.
  void readInputs(const Eigen::VectorXd& lengths, Eigen::VectorXd& input) const noexcept {
    for (int i = 0; i < size(); ++i) {
      // A length at its bound maps to exactly the limit.
      if (lengths[i] == at_lower_limit_[i]) {
        input[i] = limits(i).lower;
      } else if (lengths[i] == at_upper_limit_[i]) {
        input[i] = limits(i).upper;
      } else {
        const double q = arm_.actuator(i).contraction.inverseInside(lengths[i], input[i]);
        input[i] = std::min(std::max(q, limits(i).lower), limits(i).upper);
      }
    }
  }

 private:
  const model::Arm& arm_;
  std::vector<model::Range> limits_;
  Eigen::VectorXd at_lower_limit_, at_upper_limit_;  // lengths at the limits of the inputs [m]
  Eigen::VectorXd lower_, upper_;                    // of the lengths [m]
};

/// Residual if no shape balances the load: larger than that of any target [m].
inline constexpr double kNoBalance = 1e9;

/// The function whose root the inverse seeks: a target's weighted error by the actuators' lengths.
class InverseTask {
 public:
  enum class Kind { kPosition, kPose, kTwists };

  /// Keeps a reference to the model.
  InverseTask(const CorrectedModel& corrected, double rotation_weight)
      : model_(corrected),
        rotation_weight_(rotation_weight),
        actuators_(corrected.arm().actuatorCount()),
        single_(corrected.model().isLinear() && corrected.arm().sectionCount() == 1 &&
                !corrected.arm().links()),
        tip_by_lengths_(6, actuators_) {
    for (int k = 0; k < model_.arm().sectionCount(); ++k) {
      // Rank of the map rather than of A: an untilted ring can shear and twist, not by its muscles.
      Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(model_.arm().equilibrium(k).map);
      qr.setThreshold(1e-9);
      map_rank_ += static_cast<int>(qr.rank());
    }
  }

  void setPosition(const Eigen::Vector3d& position) {
    kind_ = Kind::kPosition;
    rows_ = 3;
    pose_.translation = position;
  }
  void setPose(const lie::SE3& pose) {
    kind_ = Kind::kPose;
    rows_ = 6;
    pose_ = pose;
  }
  void setTwists(const model::Twists& twists) {
    kind_ = Kind::kTwists;
    rows_ = maxRows();
    twists_ = twists;
    pose_ = model_.arm().tipOf(twists);
  }

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
                Eigen::MatrixXd& jacobian) const {
    if (kind_ == Kind::kPosition && single_) {
      return evaluateSingleSection(lengths, residual, jacobian);
    }
    if (kind_ == Kind::kTwists ? evaluateTwists(lengths, residual, jacobian)
                               : evaluateTip(lengths, residual, jacobian)) {
      return;
    }
    residual.setConstant(kNoBalance);
    jacobian.setZero();
  }

  /// Distance of the tip at these lengths from the wanted one [m]; infinite if no shape balances.
  double positionError(const Eigen::VectorXd& lengths) const {
    const auto shape = model_.shape(lengths);
    if (!shape) return std::numeric_limits<double>::infinity();
    return (model::tipPose(*shape).translation - pose_.translation).norm();
  }

  /// Squared residual of a given tip [m^2], for position and pose targets.
  double squaredErrorOfTip(const lie::SE3& tip) const noexcept {
    double error = (tip.translation - pose_.translation).squaredNorm();
    if (kind_ == Kind::kPose) {
      // |R - R*|_F^2 / 2 is the squared angle to first order, which suffices to rank starts.
      error +=
          0.5 * rotation_weight_ * rotation_weight_ * (tip.rotation - pose_.rotation).squaredNorm();
    }
    return error;
  }

 private:
  // The common case of one section: one set of coefficients gives the tip and its derivative.
  void evaluateSingleSection(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                             Eigen::MatrixXd& jacobian) const noexcept {
    const Correction& correction = model_.correction();
    const Eigen::VectorXd &scale = correction.length_scale, &shift = correction.length_shift;
    const auto& map = model_.arm().equilibrium(0).map;
    const auto n = static_cast<int>(map.cols());
    lie::Vector6 g = correction.offset.col(0);
    for (int i = 0; i < n; ++i) g += map.col(i) * (scale[i] * lengths[i] + shift[i]);
    const Eigen::Matrix<double, 3, 6> J = lie::SE3::translationJacobian(g);
    // dp/dv = V, and p = V v.
    residual.head<3>() = J.leftCols<3>() * g.head<3>() - pose_.translation;
    for (int i = 0; i < n; ++i) {
      jacobian.col(i).head<3>() = J.lazyProduct(map.col(i));
      jacobian.col(i).head<3>() *= scale[i];
    }
  }

  // False, with any values, if no shape balances the load.
  bool evaluateTip(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                   Eigen::MatrixXd& jacobian) const {
    lie::SE3 tip;
    if (!model_.tipByLengths(lengths, tip, tip_by_lengths_)) return false;
    residual.head<3>() = tip.translation - pose_.translation;
    for (int i = 0; i < lengths.size(); ++i) {
      jacobian.col(i).head<3>() = tip.rotation * tip_by_lengths_.col(i).head<3>();
    }
    if (kind_ != Kind::kPose) return true;
    // phi = log(R*' R); a body rotation d changes it by Jr(phi)^-1 d.
    const lie::Vector6 phi =
        lie::SE3{pose_.rotation.transpose() * tip.rotation, Eigen::Vector3d::Zero()}.log();
    residual.segment<3>(3) = rotation_weight_ * phi.tail<3>();
    const Eigen::Matrix3d by_turn =
        rotation_weight_ * lie::SE3::rightJacobianInverse(phi).bottomRightCorner<3, 3>();
    for (int i = 0; i < lengths.size(); ++i) {
      jacobian.col(i).segment<3>(3) = by_turn * tip_by_lengths_.col(i).tail<3>();
    }
    return true;
  }

  bool evaluateTwists(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                      Eigen::MatrixXd& jacobian) const {
    const auto shape = model_.shape(lengths);
    if (!shape || !model_.twistsByLengths(lengths, jacobian)) return false;
    const model::Twists g = shape->twists();
    for (int k = 0; k < g.cols(); ++k) {
      residual.segment<6>(6 * k) = g.col(k) - twists_.col(k);
      residual.segment<3>(6 * k + 3) *= rotation_weight_;
      jacobian.middleRows<3>(6 * k + 3) *= rotation_weight_;
    }
    return true;
  }

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
  InverseStarts(const ArmModel& model, const LengthBox& box) {
    const int n = box.size();
    corners_ = n <= kMaxActuatorsForCorners ? 1 << n : 0;
    lengths_.resize(n, kSamples + corners_);
    std::mt19937_64 generator(20240229);
    for (int s = 0; s < lengths_.cols(); ++s) {
      for (int i = 0; i < n; ++i) {
        const bool corner = s < corners_;
        const double fraction = corner ? (s >> i) & 1 : basics::fractionOf(generator());
        lengths_(i, s) = box.lower()[i] + fraction * (box.upper()[i] - box.lower()[i]);
      }
      // Starts are ranked with the loaded tier, which is sufficient even for the exact one.
      tips_.push_back(model.choice().setting.tier == Tier::kLoaded
                          ? model.tipOfLengths(lengths_.col(s)).tip
                          : model.arm().tipOfLengths(lengths_.col(s)));
    }
    used_.resize(lengths_.cols());
  }

  /// Lengths (n) [m] of start `number` of a task, counted from 0. The order is: the starts whose
  /// tips are nearest to the target, the nearest corners, then samples spread over all starts. Call
  /// it with consecutive numbers within one task.
  Eigen::MatrixXd::ConstColXpr next(int number, const InverseTask& task) noexcept {
    if (number == 0) std::fill(used_.begin(), used_.end(), 0);
    const int count = static_cast<int>(lengths_.cols());
    int choice = -1;
    if (number < kNearestStarts) {
      choice = nearest(count, task);
    } else if (number < kNearestStarts + kCornerStarts) {
      choice = nearest(corners_, task);
    }
    if (choice < 0) choice = std::max(0, number - kNearestStarts) * kStride % count;
    used_[choice] = 1;
    return static_cast<const Eigen::MatrixXd&>(lengths_).col(choice);
  }

 private:
  static constexpr int kSamples = 1024;
  static constexpr int kNearestStarts = 12;  // of all
  static constexpr int kCornerStarts = 10;   // then of the corners; later ones are spread over all
  static constexpr int kMaxActuatorsForCorners = 6;
  static constexpr int kStride = 97;  // between the later starts; coprime to their number

  // The start among the first `count` unused ones whose tip is nearest to the target; -1: none.
  int nearest(int count, const InverseTask& task) const noexcept {
    int choice = -1;
    double least = std::numeric_limits<double>::infinity();
    for (int s = 0; s < count; ++s) {
      if (used_[s]) continue;
      const double error = task.squaredErrorOfTip(tips_[s]);
      if (error < least) {
        least = error;
        choice = s;
      }
    }
    return choice;
  }

  Eigen::MatrixXd lengths_;  // (n x starts) [m], the corners first
  int corners_ = 0;
  std::vector<lie::SE3> tips_;
  std::vector<char> used_;
};

}  // namespace helix_arm::statics
