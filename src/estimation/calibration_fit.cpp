#include "calibration_fit.hpp"

#include <Eigen/Eigenvalues>
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
// Smallest component of an axis that makes it a valley of several logs.
constexpr double kLeastMix = 0.005;
// Points along a valley, in its standard deviations by the information: the rule gives the variance
// of a normal distribution to 1 %.
constexpr double kValleyStep = 1.5;
constexpr int kValleySteps = 2;  // to either side

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

bool hasSameName(const ParameterInfo& a, const ParameterInfo& b) { return a.name == b.name; }

// The values of `fitted` as those of a problem with more entries of the stiffness, which are held
// at their initial values.
Values valuesAmong(const std::vector<ParameterInfo>& infos, Eigen::Index entries,
                   const CalibrationProblem& fitted) {
  const std::vector<ParameterInfo>& known = fitted.parameters();
  const Eigen::VectorXd at = fitted.vector();
  Values values = fitted.values();
  values.stiffness = Eigen::VectorXd::Zero(entries);
  for (Eigen::Index i = 0; i < entries; ++i) {
    const auto found = std::find_if(known.begin(), known.end(), [&](const ParameterInfo& one) {
      return hasSameName(one, infos[static_cast<std::size_t>(i)]);
    });
    if (found != known.end()) values.stiffness[i] = at[found - known.begin()];
  }
  return values;
}

// Covariance including the uncertainty of parameters that were held at their values during the fit.
// @param all  includes the fitted parameters.
Eigen::MatrixXd withUncertaintyOfHeld(Eigen::MatrixXd covariance, const CalibrationProblem& fitted,
                                      const std::vector<ArmCaptures>& arms,
                                      const CalibrationOptions& options, const Selection& all,
                                      double noise_scale) {
  const Selection& own = fitted.selection();
  if (all.stiffness.size() == own.stiffness.size() && all.rig == own.rig) return covariance;
  CalibrationProblem everything(arms, options, all);
  const std::vector<ParameterInfo>& known = fitted.parameters();
  const std::vector<ParameterInfo>& infos = everything.parameters();
  std::vector<int> fitted_columns, held_columns;
  for (int i = 0; i < static_cast<int>(infos.size()); ++i) {
    const bool is_fitted = std::any_of(known.begin(), known.end(), [&](const ParameterInfo& one) {
      return hasSameName(one, infos[i]);
    });
    (is_fitted ? fitted_columns : held_columns).push_back(i);
  }
  if (held_columns.empty()) return covariance;
  everything.values() = valuesAmong(infos, everything.values().stiffness.size(), fitted);
  const Eigen::MatrixXd H = statisticsOf(everything, noise_scale).information;
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
      const Eigen::VectorXd axis = Eigen::VectorXd::Unit(entries, e);
      const double rise = problem.solve(best.solved_scale, everyCapture, &axis).cost - best.cost;
      profile = std::max(profile, kSpan * kSpan / (2 * std::max(rise, kLeastRise)));
      problem.values() = full;
    }
    more += (profile - variance) * along * along.transpose();
  }
  return more;
}

// Posterior of the stiffness logs along a valley, about the problem's values.
struct ValleySpread {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
};

// Sampled at some points along the axis, with everything else refitted.
ValleySpread spreadAlong(CalibrationProblem& problem, double noise_scale,
                         const Eigen::VectorXd& axis, double deviation) {
  const Values best = problem.values();
  const Eigen::Index entries = best.stiffness.size();
  std::vector<Eigen::VectorXd> points;
  std::vector<double> costs;
  for (int k = -kValleySteps; k <= kValleySteps; ++k) {
    problem.values() = best;
    problem.values().stiffness += k * kValleyStep * deviation * axis;
    const double cost = problem.solve(noise_scale, everyCapture, &axis).cost;
    const Eigen::VectorXd& at = problem.values().stiffness;
    if (!std::isfinite(cost) || !at.allFinite()) continue;
    points.push_back(at - best.stiffness);
    costs.push_back(cost);
  }
  problem.values() = best;
  ValleySpread out{Eigen::VectorXd::Zero(entries), Eigen::MatrixXd::Zero(entries, entries)};
  if (costs.empty()) return out;
  const double least = *std::min_element(costs.begin(), costs.end());
  double sum = 0;
  for (std::size_t k = 0; k < points.size(); ++k) {
    const double weight = std::exp(least - costs[k]);
    sum += weight;
    out.mean += weight * points[k];
    out.covariance += weight * points[k] * points[k].transpose();
  }
  out.mean /= sum;
  out.covariance = (out.covariance / sum - out.mean * out.mean.transpose()).eval();
  return out;
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

// @param all  parameters that could be fitted.
Candidate candidateOf(const std::vector<ArmCaptures>& arms, const CalibrationOptions& options,
                      const Selection& selection, const Selection& all, double bias) {
  Candidate candidate;
  CalibrationFit& fit = candidate.fit;
  fit.problem = std::make_shared<CalibrationProblem>(arms, options, selection);
  const Estimate estimate = solveWithNoise(*fit.problem, bias);
  fit.converged = estimate.converged;
  fit.noise_scale = estimate.noise_scale;
  Statistics statistics = statisticsOf(*fit.problem, fit.noise_scale);
  fit.determined = estimate.determined && statistics.determined;
  fit.converged = fit.converged && fit.determined;
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
  fit.covariance = withUncertaintyOfHeld(statistics.covariance, *fit.problem, arms, options, all,
                                         fit.noise_scale);
  fit.covariance += bendingOfValleys(*fit.problem, estimate, statistics.covariance);
  judge(fit.covariance);
  return candidate;
}

// Error of the readings that the residuals do not show, in expected standard deviations.
double noiseBias(const CalibrationOptions& options, ReadingKind kind) {
  return kind == ReadingKind::kCorners ? options.corner_floor / options.corner_noise : 0.0;
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

CalibrationFit fitRequested(const std::vector<ArmCaptures>& arms, const CalibrationOptions& options,
                            const Selection& wanted, ReadingKind kind) {
  CalibrationFit fit;
  fit.problem = std::make_shared<CalibrationProblem>(arms, options, wanted);
  const Estimate estimate = solveWithNoise(*fit.problem, noiseBias(options, kind));
  fit.converged = estimate.converged;
  fit.determined = estimate.determined;
  fit.noise_scale = estimate.noise_scale;
  return fit;
}

bool isIdentified(const ParameterInfo& info, double variance) {
  const bool known = !info.logarithmic || variance <= kLargestRelativeError * kLargestRelativeError;
  return known && variance <= (1 - kLeastGain) * info.deviation * info.deviation;
}

CalibrationFit fitIdentified(const std::vector<ArmCaptures>& arms,
                             const CalibrationOptions& options, const Selection& wanted,
                             ReadingKind kind,
                             const std::function<bool(const CalibrationFit&)>& holds_up) {
  const double bias = noiseBias(options, kind);
  const Selection all = allOf(wanted, arms, kind);
  const auto isGood = [&](const CalibrationFit& fit) {
    return fit.converged && stiffnessIsIdentified(fit) && holds_up(fit);
  };
  Candidate first = candidateOf(arms, options, wanted, all, bias);
  if (first.fit.converged) first.fit.asked = first.fit.problem;
  first.fit.asked_noise_scale = first.fit.noise_scale;
  const std::shared_ptr<CalibrationProblem> asked = first.fit.asked;
  const double asked_noise_scale = first.fit.asked_noise_scale;
  if (isGood(first.fit) || wanted.stiffness.empty() || !first.fit.determined) {
    return std::move(first.fit);
  }
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
    fit.asked = asked;
    fit.asked_noise_scale = asked_noise_scale;
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

Eigen::MatrixXd stiffnessErrors(const std::vector<ArmCaptures>& arms,
                                const CalibrationOptions& options, const CalibrationFit& fit,
                                ReadingKind kind) {
  CalibrationProblem& asked = *fit.asked;
  const Eigen::VectorXd optimum = asked.values().stiffness;
  const Eigen::Index entries = optimum.size();
  const Eigen::MatrixXd own = statisticsOf(asked, fit.asked_noise_scale).covariance;
  Eigen::MatrixXd covariance =
      withUncertaintyOfHeld(own, asked, arms, options, allOf(asked.selection(), arms, kind),
                            fit.asked_noise_scale)
          .topLeftCorner(entries, entries);
  const Values reported = valuesAmong(asked.parameters(), entries, *fit.problem);
  Eigen::VectorXd mean = optimum - reported.stiffness;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> axes(own.topLeftCorner(entries, entries));
  for (Eigen::Index j = 0; j < entries; ++j) {
    const double variance = axes.eigenvalues()[j];
    const Eigen::VectorXd axis = axes.eigenvectors().col(j);
    // Along one parameter there is no valley that could bend into others.
    const auto mixed = (axis.array().abs() >= kLeastMix).count();
    if (variance < kSharp * kSharp || mixed < 2) continue;
    const ValleySpread spread =
        spreadAlong(asked, fit.asked_noise_scale, axis, std::sqrt(variance));
    covariance += spread.covariance - variance * axis * axis.transpose();
    mean += spread.mean;
  }
  return covariance + mean * mean.transpose();
}

}  // namespace helix_arm::estimation
