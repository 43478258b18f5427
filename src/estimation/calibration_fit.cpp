#include "calibration_fit.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "calibration_statistics.hpp"
#include "shape_model.hpp"

namespace helix_arm::estimation {
namespace {

// The captures identify a parameter if they reduce the variance of its prior by this fraction.
constexpr double kLeastGain = 0.75;
// Logs of a stiffness with a smaller error are hardly affected by the curvature of their valley.
constexpr double kSharp = 0.1;
// Range on either side of a fitted log over which the valley is sampled: twice the largest
// permitted error.
constexpr double kSpan = 2 * kLargestRelativeError;
constexpr double kLeastRise = 1e-6;

bool everyCapture(int) { return true; }

Parameter heldParameter(const ParameterInfo& info) {
  return {info.name,
          info.unit,
          info.initial,
          info.initial,
          standardErrorOf(info, info.reference, info.deviation),
          false};
}

// All parameters that affect the readings and could be fitted, requested or not, except those that
// count as exact.
Selection allOf(Selection wanted, const std::vector<ArmCaptures>& arms, ReadingKind kind) {
  for (const FitParameterInfo& info : fitParameters()) {
    if (!info.uncertain_if_held || !info.aboutRig() || arms.size() != 1) continue;
    if (isMet(info.need, kind)) wanted.rig.insert(*info.block);
  }
  if (wanted.free_shapes) return wanted;
  Elasticity initial = ShapeModel(arms, {}).initial();
  std::vector<StiffnessEntry>& entries = wanted.stiffness;
  for (const FitParameterInfo& info : fitParameters()) {
    if (!info.uncertain_if_held || !info.entry) continue;
    const bool asked = std::find(entries.begin(), entries.end(), *info.entry) != entries.end();
    // Entries that are absent from the scene stay absent.
    if (!asked && entryOf(initial, *info.entry) > 0) entries.push_back(*info.entry);
  }
  return wanted;
}

// Covariance including the uncertainty of parameters that were held at their values during the fit.
// @param all  problem whose parameters include the fitted ones; moved to their values.
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
  all.values() = values;
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

// The information sees a valley as straight. Where it bends, values far along it fit nearly as
// well: the profile of the cost, with the other parameters refitted, tells how far.
//
// @param covariance  (parameters)^2 without what is not known of all that is not fitted.
// @return what to add to it.
Eigen::MatrixXd bendingOfValleys(CalibrationProblem& problem, const Estimate& best,
                                 const Eigen::MatrixXd& covariance) {
  const Values full = problem.values();
  Eigen::MatrixXd more = Eigen::MatrixXd::Zero(covariance.rows(), covariance.cols());
  const int entries = static_cast<int>(full.stiffness.size());
  for (int e = 0; e < entries; ++e) {
    const double variance = covariance(e, e);
    if (variance < kSharp * kSharp) continue;
    const Eigen::VectorXd along = covariance.col(e) / variance;
    double profile = variance;
    for (const double side : {-kSpan, kSpan}) {
      problem.values().stiffness += side * along.head(entries);
      const double rise = problem.solve(best.solved_scale, everyCapture, e).cost - best.cost;
      profile = std::max(profile, kSpan * kSpan / (2 * std::max(rise, kLeastRise)));
      problem.values() = full;
    }
    more += (profile - variance) * along * along.transpose();
  }
  return more;
}

struct Candidate {
  CalibrationFit fit;
  Eigen::MatrixXd marginal;  // (entries of the stiffness)^2, all others fitted
};

bool stiffnessIsIdentified(const CalibrationFit& fit) {
  const auto entries = static_cast<std::ptrdiff_t>(fit.problem->selection().stiffness.size());
  return std::all_of(fit.identified.begin(), fit.identified.begin() + entries,
                     [](bool identified) { return identified; });
}

// @param all  problem of all parameters that could be fitted.
Candidate candidateOf(const std::vector<ArmCaptures>& arms, const CalibrationOptions& options,
                      const Selection& selection, const Selection& all, double bias) {
  Candidate candidate;
  CalibrationFit& fit = candidate.fit;
  fit.problem = std::make_unique<CalibrationProblem>(arms, options, selection);
  const Estimate estimate = solveWithNoise(*fit.problem, bias);
  fit.converged = estimate.converged;
  fit.noise_scale = estimate.noise_scale;
  Statistics statistics = statisticsOf(*fit.problem, fit.noise_scale);
  fit.information = std::move(statistics.information);
  const auto entries = static_cast<Eigen::Index>(selection.stiffness.size());
  candidate.marginal = statistics.covariance.topLeftCorner(entries, entries);
  const std::vector<ParameterInfo>& infos = fit.problem->parameters();
  const auto judge = [&](const Eigen::MatrixXd& covariance) {
    fit.identified.clear();
    for (std::size_t i = 0; i < infos.size(); ++i) {
      fit.identified.push_back(isIdentified(infos[i], covariance(i, i)));
    }
  };
  fit.covariance = statistics.covariance;
  judge(fit.covariance);
  if (!fit.converged || !stiffnessIsIdentified(fit)) return candidate;
  CalibrationProblem everything(arms, options, all);
  fit.covariance =
      withUncertaintyOfHeld(statistics.covariance, *fit.problem, everything, fit.noise_scale);
  fit.covariance += bendingOfValleys(*fit.problem, estimate, statistics.covariance);
  judge(fit.covariance);
  return candidate;
}

// A division of some entries into fitted and held ones; held entries keep their priors.
struct Split {
  std::vector<int> fitted;
  double entropy = 0;  // of the fitted ones, as estimated before the fit
};

// All ways to hold one entry or more: those that hold fewest first, and among equals those with the
// smallest entropy. @param information  (entries)^2 including the priors.
std::vector<Split> splitsOf(const Eigen::MatrixXd& information, double prior_variance) {
  const int entries = static_cast<int>(information.rows());
  std::vector<Split> splits;
  for (int mask = (1 << entries) - 2; mask >= 0; --mask) {
    Split split;
    std::vector<int> held;
    for (int e = 0; e < entries; ++e) (mask >> e & 1 ? split.fitted : held).push_back(e);
    if (!split.fitted.empty()) {
      const Eigen::MatrixXd covariance =
          Eigen::MatrixXd(information(split.fitted, split.fitted)).inverse();
      const Eigen::MatrixXd shift = covariance * information(split.fitted, held);
      const Eigen::MatrixXd total = covariance + prior_variance * shift * shift.transpose();
      split.entropy = total.diagonal().array().log().sum();
    }
    splits.push_back(std::move(split));
  }
  std::stable_sort(splits.begin(), splits.end(), [](const Split& a, const Split& b) {
    return a.fitted.size() != b.fitted.size() ? a.fitted.size() > b.fitted.size()
                                              : a.entropy < b.entropy;
  });
  return splits;
}

bool hasOthers(const Selection& selection) {
  return selection.length_scale != LengthScaling::kNone || !selection.rig.empty() ||
         selection.curve;
}

}  // namespace

bool isIdentified(const ParameterInfo& info, double variance) {
  const bool known = !info.logarithmic || variance <= kLargestRelativeError * kLargestRelativeError;
  return known && variance <= (1 - kLeastGain) * info.deviation * info.deviation;
}

CalibrationFit fitIdentified(const std::vector<ArmCaptures>& arms,
                             const CalibrationOptions& options, const Selection& wanted,
                             ReadingKind kind,
                             const std::function<bool(const CalibrationFit&)>& holds_up) {
  const double bias =
      kind == ReadingKind::kCorners ? options.corner_floor / options.corner_noise : 0.0;
  const Selection all = allOf(wanted, arms, kind);
  const auto isGood = [&](const CalibrationFit& fit) {
    return fit.converged && stiffnessIsIdentified(fit) && holds_up(fit);
  };
  Candidate first = candidateOf(arms, options, wanted, all, bias);
  if (isGood(first.fit) || wanted.stiffness.empty()) return std::move(first.fit);
  const std::vector<ParameterInfo> infos = first.fit.problem->parameters();
  const auto hold = [&infos, &wanted](CalibrationFit& fit, const std::vector<int>& fitted) {
    for (int e = 0; e < static_cast<int>(wanted.stiffness.size()); ++e) {
      const bool stays = std::find(fitted.begin(), fitted.end(), e) == fitted.end();
      if (stays) fit.held.push_back(heldParameter(infos[e]));
    }
  };
  CalibrationFit last = std::move(first.fit);
  for (const Split& split :
       splitsOf(first.marginal.inverse(), options.stiffness_prior * options.stiffness_prior)) {
    if (split.fitted.empty() && !hasOthers(wanted)) break;
    Selection selection = wanted;
    selection.stiffness.clear();
    for (const int e : split.fitted) selection.stiffness.push_back(wanted.stiffness[e]);
    CalibrationFit fit = candidateOf(arms, options, selection, all, bias).fit;
    if (split.fitted.empty() || isGood(fit)) {
      hold(fit, split.fitted);
      if (split.fitted.empty() && fit.converged) holds_up(fit);
      return fit;
    }
    if (fit.converged || !last.converged) last = std::move(fit);
  }
  hold(last, {});
  return last;
}

}  // namespace helix_arm::estimation
