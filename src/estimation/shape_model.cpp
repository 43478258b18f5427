#include "shape_model.hpp"

#include <algorithm>
#include <cmath>

namespace helix_arm::estimation {
namespace {

// Of the logs: step of the central differences of the maps, with an error of its square.
constexpr double kMapStep = 1e-4;
// Of the bending stiffness of an arm that has none yet, in squares of its actuators' offset.
constexpr double kLikelyBending = 0.2;

}  // namespace

double& entryOf(model::Stiffness& stiffness, StiffnessEntry entry) {
  switch (entry) {
    case StiffnessEntry::kKappa:
      return stiffness.kappa;
    case StiffnessEntry::kGamma:
      return stiffness.gamma;
    case StiffnessEntry::kTau:
      break;
  }
  return stiffness.tau;
}

ShapeModel::ShapeModel(const std::vector<ArmCaptures>& arms,
                       const std::vector<StiffnessEntry>& fitted)
    : arms_(arms), fitted_(fitted) {
  initial_ = arms.front().arm.actuator(0).stiffness;
  reference_ = initial_;
  double offset = 0;
  for (int i = 0; i < arms.front().arm.actuatorCount(); ++i) {
    offset = std::max(offset, arms.front().arm.actuator(i).X_O.translation.squaredNorm());
  }
  if (!(reference_.kappa > 0)) reference_.kappa = kLikelyBending * offset;
  if (!(reference_.gamma > 0)) reference_.gamma = 1.0;
  if (!(reference_.tau > 0)) reference_.tau = reference_.kappa;
}

model::Stiffness ShapeModel::stiffnessAt(const double* logs, model::Stiffness stiffness) const {
  for (std::size_t e = 0; e < fitted_.size(); ++e) {
    entryOf(stiffness, fitted_[e]) = referenceOf(fitted_[e]) * std::exp(logs[e]);
  }
  return stiffness;
}

model::Twists ShapeModel::twists(int a, const Eigen::VectorXd& lengths, const double* logs,
                                 Eigen::MatrixXd* by_stiffness) {
  update(logs, by_stiffness != nullptr);
  const model::Arm& arm = arms_[a].arm;
  model::Twists out(6, arm.sectionCount());
  if (by_stiffness) by_stiffness->resize(6 * arm.sectionCount(), size());
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const auto l = lengths.segment(arm.firstActuator(k), count(arm, k));
    out.col(k) = maps_[a][k] * l;
    for (int e = 0; by_stiffness && e < size(); ++e) {
      by_stiffness->block<6, 1>(6 * k, e) = changes_[a][k][e] * l;
    }
  }
  return out;
}

ShapeModel::Maps ShapeModel::mapsAt(const Eigen::VectorXd& logs) const {
  Maps maps(arms_.size());
  for (std::size_t a = 0; a < arms_.size(); ++a) {
    const model::Arm& arm = arms_[a].arm;
    for (int k = 0; k < arm.sectionCount(); ++k) {
      std::vector<model::Strand<lie::SE3>> strands;
      for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
        const model::Actuator& actuator = arm.actuator(i);
        strands.push_back(
            {actuator.X_O, stiffnessAt(logs.data(), actuator.stiffness).diagonal<lie::SE3>()});
      }
      maps[a].emplace_back(model::solveEquilibrium(strands).map);
    }
  }
  return maps;
}

void ShapeModel::update(const double* logs, bool derivatives) {
  const Eigen::VectorXd at = Eigen::Map<const Eigen::VectorXd>(logs, size());
  const bool known = !maps_.empty() && at_ == at;
  if (known && (has_changes_ || !derivatives)) return;
  if (!known) maps_ = mapsAt(at);
  at_ = at;
  has_changes_ = derivatives;
  if (!derivatives) return;
  changes_.assign(arms_.size(), {});
  for (std::size_t a = 0; a < arms_.size(); ++a) {
    changes_[a].assign(arms_[a].arm.sectionCount(), std::vector<Eigen::MatrixXd>(fitted_.size()));
  }
  for (int e = 0; e < size(); ++e) {
    const Eigen::VectorXd step = kMapStep * Eigen::VectorXd::Unit(size(), e);
    const Maps above = mapsAt(at + step), below = mapsAt(at - step);
    for (std::size_t a = 0; a < arms_.size(); ++a) {
      for (std::size_t k = 0; k < above[a].size(); ++k) {
        changes_[a][k][e] = (above[a][k] - below[a][k]) / (2 * kMapStep);
      }
    }
  }
}

}  // namespace helix_arm::estimation
