#include "helix_arm/statics/correction.hpp"

#include <utility>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/curve.hpp"
#include "statics/loaded/shape_motion.hpp"

namespace helix_arm::statics {
namespace {

constexpr char kCulprit[] = "correction of the model";
constexpr double kStep = 3e-5;  // of differences under load, relative to the arm's length

// Whose shapes are the same twists, without what they do not depend on.
ArmModel linearOf(const ArmModel& model) {
  return {model.arm(), std::nullopt, std::nullopt, TierSetting{Tier::kLinear, 0}};
}

}  // namespace

Correction::Correction(const model::Arm& arm)
    : offset(model::Twists::Zero(6, arm.sectionCount())),
      stiffness_factors{1.0, 1.0, 1.0},
      length_scale(Eigen::VectorXd::Ones(arm.actuatorCount())),
      length_shift(Eigen::VectorXd::Zero(arm.actuatorCount())) {}

CorrectedModel::CorrectedModel(const ArmModel& model)
    : nominal_(model.isLinear() ? linearOf(model) : model),
      model_(nominal_),
      correction_(model.arm()),
      scaled_(model.arm().actuatorCount()) {}

void CorrectedModel::set(const Correction& correction) {
  const model::Arm& arm = nominal_.arm();
  const model::Stiffness &factors = correction.stiffness_factors,
                         &before = correction_.stiffness_factors;
  basics::requireValue(correction.offset.cols() == arm.sectionCount(), kCulprit,
                       "the number of sections of the offset", correction.offset.cols(),
                       "as many as the arm has");
  basics::require(correction.offset.allFinite(), kCulprit, ": the offset is not finite");
  basics::requireValue(correction.length_scale.size() == arm.actuatorCount(), kCulprit,
                       "the number of length scales", correction.length_scale.size(),
                       "one per actuator");
  basics::require(
      correction.length_shift.size() == arm.actuatorCount() && correction.length_shift.allFinite(),
      kCulprit, ": the shifts of the lengths are not one finite number per actuator");
  for (const double scale : correction.length_scale) {
    basics::requirePositive(kCulprit, "a length scale", scale);
  }
  basics::requirePositive(kCulprit, {{"the factor on K_gamma", factors.gamma},
                                     {"the factor on K_tau", factors.tau},
                                     {"the factor on K_kappa", factors.kappa},
                                     {"the factor on K_eps", correction.K_eps_factor}});
  const bool same = factors.gamma == before.gamma && factors.tau == before.tau &&
                    factors.kappa == before.kappa &&
                    (model_.isLinear() || correction.K_eps_factor == correction_.K_eps_factor);
  correction_ = correction;
  moves_twists_ = !correction.offset.isZero(0);
  if (!same) model_ = nominal_.scaledStiffness(factors, correction.K_eps_factor);
}

const Eigen::VectorXd& CorrectedModel::scaled(const Eigen::VectorXd& lengths) const noexcept {
  scaled_ = correction_.length_scale.cwiseProduct(lengths) + correction_.length_shift;
  return scaled_;
}

std::optional<model::Shape> CorrectedModel::shape(const Eigen::VectorXd& lengths) const {
  if (model_.isLinear()) {
    const model::Arm& arm = model_.arm();
    return model::shapeOf(arm,
                          model::Twists(arm.twistsOfLengths(scaled(lengths)) + correction_.offset));
  }
  Solution solution = model_.solveLengths(scaled(lengths));
  if (!solution.converged()) return std::nullopt;
  if (!moves_twists_) return std::move(solution.shape);
  return solution.shape.about(solution.shape.twists() + correction_.offset);
}

bool CorrectedModel::tipByLengths(const Eigen::VectorXd& lengths, lie::SE3& tip,
                                  Eigen::MatrixXd& by_lengths) const {
  by_lengths.resize(6, lengths.size());
  if (model_.isLinear()) {
    const model::Arm& arm = model_.arm();
    const model::Twists twists = arm.twistsOfLengths(scaled(lengths)) + correction_.offset;
    tip = arm.tipOf(twists);
    forTipMotions(arm, twists, [&](int i, const lie::Vector6& motion) {
      by_lengths.col(i) = correction_.length_scale[i] * motion;
    });
    return true;
  }
  const TipResponse response = model_.tipResponse(scaled(lengths));
  if (!response.converged()) return false;
  tip = response.tip;
  if (moves_twists_) {
    const auto corrected = shape(lengths);
    if (!corrected) return false;
    tip = model::tipPose(*corrected);
  }
  by_lengths = response.by * correction_.length_scale.asDiagonal();
  return true;
}

bool CorrectedModel::twistsByLengths(const Eigen::VectorXd& lengths, Eigen::MatrixXd& out) const {
  const model::Arm& arm = model_.arm();
  out.setZero(6 * arm.sectionCount(), arm.actuatorCount());
  for (int k = 0; k < arm.sectionCount() && model_.isLinear(); ++k) {
    const auto& map = arm.equilibrium(k).map;
    const int first = arm.firstActuator(k);
    for (int i = 0; i < map.cols(); ++i) {
      out.block<6, 1>(6 * k, first + i) = map.col(i) * correction_.length_scale[first + i];
    }
  }
  if (model_.isLinear()) return true;
  const double step = kStep * arm.restLength();
  Eigen::VectorXd moved = lengths;
  for (int i = 0; i < lengths.size(); ++i) {
    moved[i] = lengths[i] - step;
    const auto below = shape(moved);
    moved[i] = lengths[i] + step;
    const auto above = shape(moved);
    moved[i] = lengths[i];
    if (!below || !above) {
      out.setZero();
      return false;
    }
    out.col(i) = (above->twists() - below->twists()).reshaped() / (2.0 * step);
  }
  return true;
}

}  // namespace helix_arm::statics
