#include "inverse_task.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <cstdint>
#include <limits>
#include <random>

#include "basics/fraction.hpp"
#include "helix_arm/model/curve.hpp"
#include "statics/loaded/shape_motion.hpp"

namespace helix_arm::statics {
namespace {

constexpr double kMapRankTolerance = 1e-9;

void giveUp(Eigen::VectorXd& residual, Eigen::MatrixXd& jacobian) {
  residual.setConstant(kNoBalance);
  jacobian.setZero();
}

}  // namespace

using lie::SE3;
using lie::Vector6;

InverseTask::InverseTask(const model::Arm& arm, const ArmModel* loaded, double rotation_weight)
    : arm_(&arm),
      loaded_(loaded),
      rotation_weight_(rotation_weight),
      offset_(model::Twists::Zero(6, arm.sectionCount())),
      scale_(Eigen::VectorXd::Ones(arm.actuatorCount())),
      shift_(Eigen::VectorXd::Zero(arm.actuatorCount())),
      scaled_(arm.actuatorCount()) {
  for (int k = 0; k < arm.sectionCount(); ++k) {
    // Rank of the map rather than of A: an untilted ring can shear and twist, but its muscles
    // cannot cause it.
    Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(arm.equilibrium(k).map);
    qr.setThreshold(kMapRankTolerance);
    map_rank_ += static_cast<int>(qr.rank());
  }
}

void InverseTask::correctBy(const CorrectedModel& corrected) {
  arm_ = &corrected.arm();
  loaded_ = corrected.loaded();
  offset_ = corrected.correction().offset;
  scale_ = corrected.correction().length_scale;
  shift_ = corrected.correction().length_shift;
  corrected_ = true;
}

const Eigen::VectorXd& InverseTask::scaled(const Eigen::VectorXd& lengths) const noexcept {
  scaled_ = scale_.cwiseProduct(lengths) + shift_;
  return scaled_;
}

model::Twists InverseTask::twistsAt(const Eigen::VectorXd& lengths) const noexcept {
  return arm_->twistsOfLengths(scaled(lengths)) + offset_;
}

std::optional<model::Shape> InverseTask::loadedShape(const Eigen::VectorXd& lengths) const {
  const Solution solution = loaded_->solveLengths(scaled(lengths));
  if (!solution.converged()) return std::nullopt;
  return corrected_ ? solution.shape.about(solution.shape.twists() + offset_) : solution.shape;
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
  rows_ = 6 * arm_->sectionCount();
  twists_ = twists;
  pose_ = arm_->tipOf(twists);
}

void InverseTask::evaluate(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                           Eigen::MatrixXd& jacobian) const {
  if (loaded_ != nullptr) {
    return kind_ == Kind::kTwists ? evaluateLoadedTwists(lengths, residual, jacobian)
                                  : evaluateLoadedTip(lengths, residual, jacobian);
  }
  if (kind_ == Kind::kTwists) return evaluateTwists(lengths, residual, jacobian);
  if (kind_ == Kind::kPosition && arm_->sectionCount() == 1 && !arm_->links())
    return evaluateSingleSection(lengths, residual, jacobian);
  evaluateTip(lengths, residual, jacobian);
}

// The common case of one section: one set of coefficients gives the tip and its derivative.
void InverseTask::evaluateSingleSection(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                                        Eigen::MatrixXd& jacobian) const noexcept {
  const auto& map = arm_->equilibrium(0).map;
  const int n = arm_->actuatorCount();
  Vector6 g = offset_.col(0);
  for (int i = 0; i < n; ++i) g += map.col(i) * (scale_[i] * lengths[i] + shift_[i]);
  const Eigen::Matrix<double, 3, 6> J = SE3::translationJacobian(g);
  residual.head<3>() = J.leftCols<3>() * g.head<3>() - pose_.translation;  // dp/dv = V, and p = V v
  for (int i = 0; i < n; ++i) {
    jacobian.col(i).head<3>() = J.lazyProduct(map.col(i));
    jacobian.col(i).head<3>() *= scale_[i];
  }
}

Eigen::Matrix3d InverseTask::compareTip(const SE3& tip, Eigen::VectorXd& residual) const noexcept {
  residual.head<3>() = tip.translation - pose_.translation;
  if (kind_ != Kind::kPose) return Eigen::Matrix3d::Zero();
  // phi = log(R*' R); a body rotation d changes it by Jr(phi)^-1 d.
  Vector6 phi = SE3{pose_.rotation.transpose() * tip.rotation, Eigen::Vector3d::Zero()}.log();
  residual.segment<3>(3) = rotation_weight_ * phi.tail<3>();
  return rotation_weight_ * SE3::rightJacobianInverse(phi).bottomRightCorner<3, 3>();
}

void InverseTask::setColumn(const SE3& tip, const Vector6& motion, const Eigen::Matrix3d& by_turn,
                            int column, Eigen::MatrixXd& jacobian) const noexcept {
  jacobian.col(column).head<3>() = tip.rotation * motion.head<3>();
  if (kind_ == Kind::kPose) jacobian.col(column).segment<3>(3) = by_turn * motion.tail<3>();
}

void InverseTask::evaluateTip(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                              Eigen::MatrixXd& jacobian) const noexcept {
  const model::Twists g = twistsAt(lengths);
  const SE3 tip = arm_->tipOf(g);
  const Eigen::Matrix3d by_turn = compareTip(tip, residual);
  forTipMotions(*arm_, g, [&](int i, const Vector6& motion) {
    setColumn(tip, scale_[i] * motion, by_turn, i, jacobian);
  });
}

void InverseTask::evaluateLoadedTip(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                                    Eigen::MatrixXd& jacobian) const {
  const TipResponse response = loaded_->tipResponse(scaled(lengths));
  if (response.status != SolveStatus::kConverged) return giveUp(residual, jacobian);
  SE3 tip = response.tip;
  if (corrected_) {
    const auto shape = loadedShape(lengths);
    if (!shape) return giveUp(residual, jacobian);
    tip = model::tipPose(*shape);
  }
  const Eigen::Matrix3d by_turn = compareTip(tip, residual);
  for (int i = 0; i < response.by_lengths.cols(); ++i) {
    setColumn(tip, scale_[i] * response.by_lengths.col(i), by_turn, i, jacobian);
  }
}

// By differences, since there is no closed form for the mean twists.
void InverseTask::evaluateLoadedTwists(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                                       Eigen::MatrixXd& jacobian) const {
  const double step_size = 3e-5 * arm_->restLength();
  const auto here = loadedShape(lengths);
  if (!here) return giveUp(residual, jacobian);
  const auto weigh = [this](auto&& rows) {
    for (int k = 0; k < arm_->sectionCount(); ++k)
      rows.template middleRows<3>(6 * k + 3) *= rotation_weight_;
  };
  residual.head(rows_) = (here->twists() - twists_).reshaped();
  weigh(residual);
  for (int i = 0; i < lengths.size(); ++i) {
    const Eigen::VectorXd step = step_size * Eigen::VectorXd::Unit(lengths.size(), i);
    const auto below = loadedShape(lengths - step);
    const auto above = loadedShape(lengths + step);
    if (!below || !above) return giveUp(residual, jacobian);
    jacobian.col(i).head(rows_) =
        (above->twists() - below->twists()).reshaped() / (2.0 * step_size);
  }
  weigh(jacobian);
}

void InverseTask::evaluateTwists(const Eigen::VectorXd& lengths, Eigen::VectorXd& residual,
                                 Eigen::MatrixXd& jacobian) const noexcept {
  const model::Twists g = twistsAt(lengths);
  jacobian.topRows(rows_).setZero();
  for (int k = 0; k < arm_->sectionCount(); ++k) {
    residual.segment<6>(6 * k) = g.col(k) - twists_.col(k);
    residual.segment<3>(6 * k + 3) *= rotation_weight_;
    const auto& map = arm_->equilibrium(k).map;
    auto block = jacobian.block(6 * k, arm_->firstActuator(k), 6, map.cols());
    block = map;
    for (int i = 0; i < map.cols(); ++i) block.col(i) *= scale_[arm_->firstActuator(k) + i];
    block.bottomRows<3>() *= rotation_weight_;
  }
}

double InverseTask::positionError(const Eigen::VectorXd& lengths) const {
  SE3 tip;
  if (loaded_ == nullptr) {
    tip = arm_->tipOf(twistsAt(lengths));
  } else if (const auto shape = corrected_ ? loadedShape(lengths) : std::nullopt) {
    tip = model::tipPose(*shape);
  } else {
    tip = loaded_->tipOfLengths(scaled(lengths)).tip;
  }
  return (tip.translation - pose_.translation).norm();
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

InverseStarts::InverseStarts(const model::Arm& arm, const ArmModel* loaded, const LengthBox& box) {
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
    const bool by_load = loaded != nullptr && loaded->choice().setting.tier == Tier::kLoaded;
    tips_.push_back(by_load ? loaded->tipOfLengths(lengths_.col(s)).tip
                            : arm.tipOfLengths(lengths_.col(s)));
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
