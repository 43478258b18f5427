#include "inverse_task.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <cstdint>
#include <limits>
#include <random>

#include "basics/fraction.hpp"
#include "helix_arm/model/curve.hpp"

namespace helix_arm::statics {
namespace {

constexpr double kMapRankTolerance = 1e-9;

}  // namespace

using lie::SE3;
using lie::Vector6;

InverseTask::InverseTask(const CorrectedModel& corrected, double rotation_weight)
    : model_(corrected),
      rotation_weight_(rotation_weight),
      actuators_(corrected.arm().actuatorCount()),
      single_(corrected.model().isLinear() && corrected.arm().sectionCount() == 1 &&
              !corrected.arm().links()),
      tip_by_lengths_(6, actuators_) {
  for (int k = 0; k < model_.arm().sectionCount(); ++k) {
    // Rank of the map rather than of A: an untilted ring can shear and twist, but its muscles
    // cannot cause it.
    Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(model_.arm().equilibrium(k).map);
    qr.setThreshold(kMapRankTolerance);
    map_rank_ += static_cast<int>(qr.rank());
  }
}

void InverseTask::setPosition(const Eigen::Vector3d& position) {
  kind_ = Kind::kPosition;
  rows_ = 3;
  pose_.translation = position;
}

void InverseTask::setPose(const SE3& pose) {
  kind_ = Kind::kPose;
  rows_ = 6;
  pose_ = pose;
}

void InverseTask::setTwists(const model::Twists& twists) {
  kind_ = Kind::kTwists;
  rows_ = 6 * model_.arm().sectionCount();
  twists_ = twists;
  pose_ = model_.arm().tipOf(twists);
}

void InverseTask::evaluate(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
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

// The common case of one section: one set of coefficients gives the tip and its derivative.
void InverseTask::evaluateSingleSection(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                                        Eigen::MatrixXd& jacobian) const noexcept {
  const Correction& correction = model_.correction();
  const Eigen::VectorXd& scale = correction.length_scale;
  const auto& map = model_.arm().equilibrium(0).map;
  const auto n = static_cast<int>(map.cols());
  Vector6 g = correction.offset.col(0);
  for (int i = 0; i < n; ++i) g += map.col(i) * (scale[i] * lengths[i]);
  const Eigen::Matrix<double, 3, 6> J = SE3::translationJacobian(g);
  residual.head<3>() = J.leftCols<3>() * g.head<3>() - pose_.translation;  // dp/dv = V, and p = V v
  for (int i = 0; i < n; ++i) {
    jacobian.col(i).head<3>() = J.lazyProduct(map.col(i));
    jacobian.col(i).head<3>() *= scale[i];
  }
}

bool InverseTask::evaluateTip(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                              Eigen::MatrixXd& jacobian) const {
  SE3 tip;
  if (!model_.tipByLengths(lengths, tip, tip_by_lengths_)) return false;
  residual.head<3>() = tip.translation - pose_.translation;
  for (int i = 0; i < lengths.size(); ++i) {
    jacobian.col(i).head<3>() = tip.rotation * tip_by_lengths_.col(i).head<3>();
  }
  if (kind_ != Kind::kPose) return true;
  // phi = log(R*' R); a body rotation d changes it by Jr(phi)^-1 d.
  const Vector6 phi = SE3{pose_.rotation.transpose() * tip.rotation, Eigen::Vector3d::Zero()}.log();
  residual.segment<3>(3) = rotation_weight_ * phi.tail<3>();
  const Eigen::Matrix3d by_turn =
      rotation_weight_ * SE3::rightJacobianInverse(phi).bottomRightCorner<3, 3>();
  for (int i = 0; i < lengths.size(); ++i) {
    jacobian.col(i).segment<3>(3) = by_turn * tip_by_lengths_.col(i).tail<3>();
  }
  return true;
}

bool InverseTask::evaluateTwists(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
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

double InverseTask::positionError(const Eigen::VectorXd& lengths) const {
  const auto shape = model_.shape(lengths);
  if (!shape) return std::numeric_limits<double>::infinity();
  return (model::tipPose(*shape).translation - pose_.translation).norm();
}

double InverseTask::squaredErrorOfTip(const SE3& tip) const noexcept {
  double error = (tip.translation - pose_.translation).squaredNorm();
  if (kind_ == Kind::kPose) {
    // |R - R*|_F^2 / 2 is the squared angle to first order, which suffices to rank starts.
    error +=
        0.5 * rotation_weight_ * rotation_weight_ * (tip.rotation - pose_.rotation).squaredNorm();
  }
  return error;
}

namespace {

constexpr int kSamples = 1024;
constexpr int kNearestStarts = 12;  // of all
constexpr int kCornerStarts =
    10;  // then of the corners of the limits; later ones are spread over all
constexpr int kMaxActuatorsForCorners = 6;
constexpr std::uint64_t kGeneratorSeed = 20240229;
constexpr int kStride = 97;  // between the later starts; coprime to their number

}  // namespace

InverseStarts::InverseStarts(const ArmModel& model, const LengthBox& box) {
  const int n = box.size();
  corners_ = n <= kMaxActuatorsForCorners ? 1 << n : 0;
  lengths_.resize(n, kSamples + corners_);
  std::mt19937_64 generator(kGeneratorSeed);
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

// The start among the first `count` unused ones whose tip is nearest to the target; -1 if there is
// none.
int InverseStarts::nearest(int count, const InverseTask& task) const noexcept {
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

Eigen::MatrixXd::ConstColXpr InverseStarts::next(int number, const InverseTask& task) noexcept {
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

LengthBox::LengthBox(const model::Arm& arm)
    : arm_(arm),
      at_lower_limit_(arm.actuatorCount()),
      at_upper_limit_(arm.actuatorCount()),
      lower_(arm.actuatorCount()),
      upper_(arm.actuatorCount()) {
  Eigen::VectorXd lower(arm.actuatorCount()), upper(arm.actuatorCount());
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    lower[i] = arm.actuator(i).limits.lower;
    upper[i] = arm.actuator(i).limits.upper;
  }
  limits_.resize(static_cast<std::size_t>(arm.actuatorCount()));
  limit(lower, upper);
}

void LengthBox::limit(const model::InputRef& lower, const model::InputRef& upper) noexcept {
  for (int i = 0; i < arm_.actuatorCount(); ++i) {
    const model::Contraction& contraction = arm_.actuator(i).contraction;
    limits_[static_cast<std::size_t>(i)] = {lower[i], upper[i]};
    at_lower_limit_[i] = contraction.lengthInside(lower[i]);
    at_upper_limit_[i] = contraction.lengthInside(upper[i]);
  }
  lower_ = at_lower_limit_.cwiseMin(at_upper_limit_);
  upper_ = at_lower_limit_.cwiseMax(at_upper_limit_);
}

void LengthBox::readInputs(const Eigen::VectorXd& lengths, Eigen::VectorXd& input) const noexcept {
  for (int i = 0; i < size(); ++i) {
    const model::Actuator& actuator = arm_.actuator(i);
    const model::Range& limits = this->limits(i);
    // A length at its bound maps to exactly the limit.
    if (lengths[i] == at_lower_limit_[i]) {
      input[i] = limits.lower;
    } else if (lengths[i] == at_upper_limit_[i]) {
      input[i] = limits.upper;
    } else {
      const double q = actuator.contraction.inverseInside(lengths[i], input[i]);
      input[i] = std::min(std::max(q, limits.lower), limits.upper);
    }
  }
}

}  // namespace helix_arm::statics
