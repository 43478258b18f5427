#include "calibration_fit.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "calibration_statistics.hpp"

namespace helix_arm::estimation {
namespace {

// Of its prior's variance, the captures must take this share from a parameter to identify it.
constexpr double kLeastGain = 0.75;

bool isIdentified(const ParameterInfo& info, double variance) {
  return variance <= (1 - kLeastGain) * info.deviation * info.deviation;
}

// Of the first parameters, the one that keeps most of its prior's variance, unless all are
// identified.
std::optional<int> leastIdentified(const std::vector<ParameterInfo>& infos,
                                   const Eigen::MatrixXd& covariance, int first_ones) {
  std::optional<int> worst;
  double most = 0;
  for (int i = 0; i < first_ones; ++i) {
    const double variance = covariance(i, i);
    if (isIdentified(infos[i], variance)) continue;
    const double share = variance / (infos[i].deviation * infos[i].deviation);
    if (!worst || share > most) {
      worst = i;
      most = share;
    }
  }
  return worst;
}

Parameter heldParameter(const ParameterInfo& info, double variance) {
  return {info.name,
          info.unit,
          info.initial,
          info.initial,
          standardErrorOf(info, info.reference, std::sqrt(variance)),
          false};
}

// All that moves the readings and could be fitted to them, whether it was asked for or not.
Selection allOf(Selection wanted, std::size_t arms, ReadingKind kind) {
  const bool corners = kind == ReadingKind::kCorners;
  if (arms == 1 && (corners || kind == ReadingKind::kPoses)) wanted.tags = true;
  wanted.bleed |= corners && arms == 1;
  return wanted;
}

// What is not fitted is known no better than before, and the rest was fitted as if it were right.
//
// @param all  with the fitted parameters among its own; moved to their values.
Eigen::MatrixXd withUncertaintyOfHeld(Eigen::MatrixXd covariance, CalibrationProblem& fitted,
                                      CalibrationProblem& all, double noise_scale) {
  const std::vector<ParameterInfo>& known = fitted.parameters();
  const std::vector<ParameterInfo>& infos = all.parameters();
  const Eigen::VectorXd at = fitted.vector();
  Values values = fitted.values();
  values.stiffness = all.values().stiffness;
  std::vector<int> fitted_columns, held_columns;
  for (int i = 0; i < static_cast<int>(infos.size()); ++i) {
    const auto same_name = [&](const ParameterInfo& one) { return one.name == infos[i].name; };
    const auto found = std::find_if(known.begin(), known.end(), same_name);
    (found == known.end() ? held_columns : fitted_columns).push_back(i);
    if (found == known.end() || i >= values.stiffness.size()) continue;
    values.stiffness[i] = at[found - known.begin()];
  }
  if (held_columns.empty()) return covariance;
  setValues(all, values);
  const Eigen::MatrixXd H = statisticsOf(all, noise_scale).information;
  const Eigen::MatrixXd cross = H(fitted_columns, held_columns);
  const Eigen::MatrixXd shift = covariance * cross;
  Eigen::VectorXd prior(held_columns.size());
  for (std::size_t i = 0; i < held_columns.size(); ++i) {
    prior[static_cast<Eigen::Index>(i)] = std::pow(infos[held_columns[i]].deviation, 2);
  }
  covariance += shift * prior.asDiagonal() * shift.transpose();
  return covariance;
}

}  // namespace

CalibrationFit fitIdentified(const std::vector<ArmCaptures>& arms,
                             const CalibrationOptions& options, const Selection& wanted,
                             ReadingKind kind) {
  const double bias =
      kind == ReadingKind::kCorners ? options.corner_floor / options.corner_noise : 0.0;
  CalibrationFit fit;
  Statistics statistics;
  Selection selection = wanted;
  for (;;) {
    fit.problem = std::make_unique<CalibrationProblem>(arms, options, selection);
    const Estimate estimate = solveWithNoise(*fit.problem, bias);
    fit.converged = estimate.converged;
    fit.noise_scale = estimate.noise_scale;
    statistics = statisticsOf(*fit.problem, fit.noise_scale);
    const std::vector<ParameterInfo>& infos = fit.problem->parameters();
    const std::optional<int> worst =
        leastIdentified(infos, statistics.covariance, static_cast<int>(selection.stiffness.size()));
    if (!worst) break;
    fit.held.push_back(heldParameter(infos[*worst], statistics.covariance(*worst, *worst)));
    if (infos.size() == 1) break;
    selection.stiffness.erase(selection.stiffness.begin() + *worst);
  }
  const std::vector<ParameterInfo>& infos = fit.problem->parameters();
  for (std::size_t i = 0; i < infos.size(); ++i) {
    fit.identified.push_back(isIdentified(infos[i], statistics.covariance(i, i)));
  }
  fit.information = std::move(statistics.information);
  CalibrationProblem all(arms, options, allOf(wanted, arms.size(), kind));
  fit.covariance =
      withUncertaintyOfHeld(std::move(statistics.covariance), *fit.problem, all, fit.noise_scale);
  return fit;
}

void setValues(CalibrationProblem& problem, const Values& values) {
  // In place: the least squares holds on to where the values are.
  Values& to = problem.values();
  to.stiffness = values.stiffness;
  to.length_scale = values.length_scale;
  to.base = values.base;
  to.bleed = values.bleed;
  std::copy(values.tags.begin(), values.tags.end(), to.tags.begin());
  std::copy(values.shapes.begin(), values.shapes.end(), to.shapes.begin());
}

}  // namespace helix_arm::estimation
