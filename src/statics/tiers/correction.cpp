#include "helix_arm/statics/correction.hpp"

#include <utility>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/curve.hpp"
#include "statics/loaded/shape_motion.hpp"

namespace helix_arm::statics {
namespace {

constexpr char kCulprit[] = "correction of the model";
constexpr double kStep = 3e-5;  // of differences under load, relative to the arm's length

bool equal(const model::Stiffness& a, const model::Stiffness& b) {
  return a.gamma == b.gamma && a.tau == b.tau && a.kappa == b.kappa;
}

ArmModel scaledModel(const ArmModel& model, const model::Stiffness& factors, double K_eps_factor) {
  std::optional<model::PlanarArm> planar;
  if (model.planar()) planar = model.planar()->scaledStiffness(factors);
  std::optional<Load> load = model.load();
  if (load) {
    for (double& K_eps : load->K_eps) K_eps *= K_eps_factor;
  }
  return {model.arm().scaledStiffness(factors), std::move(planar), std::move(load),
          model.choice().setting};
}

}  // namespace

Correction::Correction(const model::Arm& arm)
    : offset(model::Twists::Zero(6, arm.sectionCount())),
      stiffness_factors{1.0, 1.0, 1.0},
      length_scale(Eigen::VectorXd::Ones(arm.actuatorCount())),
      length_shift(Eigen::VectorXd::Zero(arm.actuatorCount())) {}

CorrectedModel::CorrectedModel(const model::Arm& arm, const ArmModel* loaded)
    : nominal_(arm),
      nominal_loaded_(loaded != nullptr ? std::optional(*loaded) : std::nullopt),
      correction_(arm),
      arm_(arm),
      loaded_(nominal_loaded_),
      scaled_(arm.actuatorCount()) {
  basics::require(loaded != nullptr || !arm.tapered(), kCulprit,
                  ": the arm is tapered; expected its ArmModel");
}

CorrectedModel::CorrectedModel(const ArmModel& model)
    : CorrectedModel(model.arm(), model.isLinear() ? nullptr : &model) {}

void CorrectedModel::set(const Correction& correction) {
  basics::requireValue(correction.offset.cols() == nominal_.sectionCount(), kCulprit,
                       "the number of sections of the offset", correction.offset.cols(),
                       "as many as the arm has");
  basics::require(correction.offset.allFinite(), kCulprit, ": the offset is not finite");
  basics::requireValue(correction.length_scale.size() == nominal_.actuatorCount(), kCulprit,
                       "the number of length scales", correction.length_scale.size(),
                       "one per actuator");
  basics::require(correction.length_shift.size() == nominal_.actuatorCount() &&
                      correction.length_shift.allFinite(),
                  kCulprit, ": the shifts of the lengths are not one finite number per actuator");
  for (const double scale : correction.length_scale) {
    basics::requirePositive(kCulprit, "a length scale", scale);
  }
  basics::requirePositive(kCulprit, {{"the factor on K_gamma", correction.stiffness_factors.gamma},
                                     {"the factor on K_tau", correction.stiffness_factors.tau},
                                     {"the factor on K_kappa", correction.stiffness_factors.kappa},
                                     {"the factor on K_eps", correction.K_eps_factor}});
  const bool same = equal(correction.stiffness_factors, correction_.stiffness_factors) &&
                    (!loaded_ || correction.K_eps_factor == correction_.K_eps_factor);
  correction_ = correction;
  if (!same) rebuild();
}

void CorrectedModel::rebuild() {
  if (nominal_loaded_) {
    loaded_ =
        scaledModel(*nominal_loaded_, correction_.stiffness_factors, correction_.K_eps_factor);
    arm_ = loaded_->arm();
  } else {
    arm_ = nominal_.scaledStiffness(correction_.stiffness_factors);
  }
}

const Eigen::VectorXd& CorrectedModel::scaled(const Eigen::VectorXd& lengths) const noexcept {
  scaled_ = correction_.length_scale.cwiseProduct(lengths) + correction_.length_shift;
  return scaled_;
}

std::optional<model::Shape> CorrectedModel::shape(const Eigen::VectorXd& lengths) const {
  if (!loaded_) {
    return model::shapeOf(
        arm_, model::Twists(arm_.twistsOfLengths(scaled(lengths)) + correction_.offset));
  }
  const Solution solution = loaded_->solveLengths(scaled(lengths));
  if (!solution.converged()) return std::nullopt;
  return solution.shape.about(solution.shape.twists() + correction_.offset);
}

bool CorrectedModel::tipByLengths(const Eigen::VectorXd& lengths, lie::SE3& tip,
                                  Eigen::MatrixXd& by_lengths) const {
  by_lengths.resize(6, lengths.size());
  if (!loaded_) {
    const model::Twists twists = arm_.twistsOfLengths(scaled(lengths)) + correction_.offset;
    tip = arm_.tipOf(twists);
    forTipMotions(arm_, twists, [&](int i, const lie::Vector6& motion) {
      by_lengths.col(i) = correction_.length_scale[i] * motion;
    });
    return true;
  }
  const auto corrected = shape(lengths);
  const TipResponse response = loaded_->tipResponse(scaled(lengths));
  if (!corrected || response.status != SolveStatus::kConverged) return false;
  tip = model::tipPose(*corrected);
  by_lengths = response.by_lengths * correction_.length_scale.asDiagonal();
  return true;
}

void CorrectedModel::twistsByLengths(const Eigen::VectorXd& lengths, Eigen::MatrixXd& out) const {
  out.setZero(6 * arm_.sectionCount(), arm_.actuatorCount());
  if (!loaded_) {
    for (int k = 0; k < arm_.sectionCount(); ++k) {
      const auto& map = arm_.equilibrium(k).map;
      const int first = arm_.firstActuator(k);
      for (int i = 0; i < map.cols(); ++i) {
        out.block<6, 1>(6 * k, first + i) = map.col(i) * correction_.length_scale[first + i];
      }
    }
    return;
  }
  const double step = kStep * arm_.restLength();
  Eigen::VectorXd moved = lengths;
  for (int i = 0; i < lengths.size(); ++i) {
    moved[i] = lengths[i] - step;
    const auto below = shape(moved);
    moved[i] = lengths[i] + step;
    const auto above = shape(moved);
    moved[i] = lengths[i];
    if (!below || !above) {
      out.setZero();
      return;
    }
    out.col(i) = (above->twists() - below->twists()).reshaped() / (2.0 * step);
  }
}

}  // namespace helix_arm::statics
