#include "calibration_fit.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <iomanip>
#include <optional>
#include <utility>

#include "helix_arm/localization/gaussian.hpp"
#include "shape_model.hpp"

namespace helix_arm::estimation {
namespace {

// Inverse of a positive definite matrix.
Eigen::MatrixXd inverseOf(const Eigen::MatrixXd& matrix) {
  return matrix.llt().solve(Eigen::MatrixXd::Identity(matrix.rows(), matrix.cols()));
}

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
// Directions of a curve, or of a parameter that is not fitted, of which the captures tell less than
// this share of what is known of them otherwise are not tested.
constexpr double kLeastTold = 0.05;
// A parameter that is not fitted is doubted below this probability of the captures.
constexpr double kLeastProbability = 1e-3;
// Free lengths are often off by so much, without any message [1].
constexpr double kUsualLengthError = 0.01;

Parameter heldParameter(const ParameterInfo& info) {
  const double error = standardErrorOf(info, info.reference, info.deviation);
  return {info.name, info.unit, info.initial, info.initial, error, false};
}

// All parameters that affect the readings and could be fitted, requested or not, and the curve of
// measured free lengths, except those that count as exact.
CalibrationOptions withAll(CalibrationOptions wanted, const std::vector<ArmCaptures>& arms) {
  Elasticity initial = ShapeModel(arms, {}).initial();
  for (const FitParameterInfo& info : fitParameters()) {
    if (!info.uncertainIfHeld()) continue;
    // Entries that are absent from the scene stay absent.
    const bool adds = info.isStiffness()
                          ? !wanted.free_shapes && entryOf(initial, info.parameter) > 0
                          : arms.size() == 1 && isMet(info.need, kindOf(arms));
    if (adds) wanted.fit.insert(info.parameter);
  }
  if (!wanted.free_shapes && arms.front().free_curve) {
    wanted.fit.insert(FitParameter::kContraction);
  }
  return wanted;
}

// Where each parameter is among others, by its name; -1 if it is not.
std::vector<int> placesAmong(const std::vector<ParameterInfo>& others,
                             const std::vector<ParameterInfo>& infos) {
  std::vector<int> out;
  for (const ParameterInfo& info : infos) {
    const auto found =
        std::find_if(others.begin(), others.end(),
                     [&info](const ParameterInfo& other) { return other.name == info.name; });
    out.push_back(found == others.end() ? -1 : static_cast<int>(found - others.begin()));
  }
  return out;
}

// The numbers of `fitted` as those of a problem with more parameters, which are held at their
// initial values.
Eigen::VectorXd numbersAmong(const CalibrationProblem& all, const CalibrationProblem& fitted) {
  const std::vector<int> places = placesAmong(fitted.parameters(), all.parameters());
  const auto known = static_cast<Eigen::Index>(places.size());
  Eigen::VectorXd numbers = Eigen::VectorXd::Zero(all.numbers().size());
  const Eigen::Index shapes = numbers.size() - known;
  numbers.tail(shapes) = fitted.numbers().tail(shapes);
  for (Eigen::Index i = 0; i < known; ++i) {
    const int place = places[static_cast<std::size_t>(i)];
    if (place >= 0) numbers[i] = fitted.numbers()[place];
  }
  return numbers;
}

// Covariance including the uncertainty of parameters that were held at their values during the fit.
// @param asked  with all that was requested.
Eigen::MatrixXd withUncertaintyOfHeld(Eigen::MatrixXd covariance, const CalibrationProblem& fitted,
                                      const CalibrationOptions& asked, double noise_scale) {
  CalibrationProblem everything(fitted.arms(), withAll(asked, fitted.arms()));
  const std::vector<ParameterInfo>& infos = everything.parameters();
  const std::vector<int> places = placesAmong(fitted.parameters(), infos);
  std::vector<int> fitted_columns, held_columns;
  for (int i = 0; i < static_cast<int>(infos.size()); ++i) {
    (places[i] >= 0 ? fitted_columns : held_columns).push_back(i);
  }
  if (held_columns.empty()) return covariance;
  everything.setNumbers(numbersAmong(everything, fitted));
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
Eigen::MatrixXd bendingOfValleys(const CalibrationFit& best, const Eigen::MatrixXd& covariance) {
  CalibrationProblem& problem = *best.problem;
  const Eigen::VectorXd full = problem.numbers();
  Eigen::MatrixXd more = Eigen::MatrixXd::Zero(covariance.rows(), covariance.cols());
  const int entries = static_cast<int>(problem.stiffnessEntries().size());
  for (int e = 0; e < entries; ++e) {
    const double variance = covariance(e, e);
    if (variance < kSharp * kSharp) continue;
    const Eigen::VectorXd along = covariance.col(e) / variance;
    double profile = variance;
    for (const double side : {-kSpan, kSpan}) {
      Eigen::VectorXd moved = full;
      moved.head(entries) += side * along.head(entries);
      problem.setNumbers(moved);
      const Eigen::VectorXd axis = Eigen::VectorXd::Unit(entries, e);
      const double rise = problem.solve(best.solved_scale, everyCapture, &axis).cost - best.cost;
      profile = std::max(profile, kSpan * kSpan / (2 * std::max(rise, kLeastRise)));
      problem.setNumbers(full);
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
  const Eigen::VectorXd best = problem.numbers();
  const Eigen::Index entries = axis.size();
  std::vector<Eigen::VectorXd> points;
  std::vector<double> costs;
  for (int k = -kValleySteps; k <= kValleySteps; ++k) {
    Eigen::VectorXd moved = best;
    moved.head(entries) += k * kValleyStep * deviation * axis;
    problem.setNumbers(moved);
    const double cost = problem.solve(noise_scale, everyCapture, &axis).cost;
    const Eigen::VectorXd at = problem.numbers().head(entries);
    if (!std::isfinite(cost) || !at.allFinite()) continue;
    points.push_back(at - best.head(entries));
    costs.push_back(cost);
  }
  problem.setNumbers(best);
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

bool stiffnessIsIdentified(const CalibrationFit& fit) {
  const auto entries = static_cast<std::ptrdiff_t>(fit.problem->stiffnessEntries().size());
  return std::all_of(fit.identified.begin(), fit.identified.begin() + entries,
                     [](bool identified) { return identified; });
}

// @param asked  with all that was requested.
CalibrationFit candidateOf(const std::vector<ArmCaptures>& arms, const CalibrationOptions& options,
                           const CalibrationOptions& asked) {
  CalibrationFit fit;
  fit.problem = std::make_shared<CalibrationProblem>(arms, options);
  // Error of the readings that the residuals do not show.
  const bool corners = fit.problem->kind() == ReadingKind::kCorners;
  const double bias = corners ? options.corner_floor / options.corner_noise : 0.0;
  static_cast<NoisySolution&>(fit) = solveWithNoise(*fit.problem, bias);
  if (!options.errors) return fit;
  Statistics statistics = statisticsOf(*fit.problem, fit.noise_scale);
  fit.information = std::move(statistics.information);
  const std::vector<ParameterInfo>& infos = fit.problem->parameters();
  const auto judge = [&](const Eigen::MatrixXd& covariance) {
    fit.identified.clear();
    for (std::size_t i = 0; i < infos.size(); ++i) {
      fit.identified.push_back(isIdentified(infos[i], covariance(i, i)));
    }
  };
  fit.covariance = statistics.covariance;
  judge(fit.covariance);
  if (!fit.converged || !stiffnessIsIdentified(fit)) return fit;
  fit.covariance =
      withUncertaintyOfHeld(statistics.covariance, *fit.problem, asked, fit.noise_scale);
  fit.covariance += bendingOfValleys(fit, statistics.covariance);
  judge(fit.covariance);
  return fit;
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
      const Eigen::MatrixXd covariance = inverseOf(information(split.fitted, split.fitted));
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

// Whether a parameter counts as exact, and could have been requested together with the others.
bool canBeFittedAsWell(const FitParameterInfo& info, const std::vector<ArmCaptures>& arms,
                       CalibrationOptions options) {
  if (!info.block || info.uncertainIfHeld() || options.fits(info.parameter)) return false;
  if (info.block == ParameterBlock::kLengthScale && isFree(options, *info.block)) return false;
  options.fit.insert(info.parameter);
  return !unfit(arms, options);
}

// Test by the captures of a parameter that was not fitted.
struct HeldTest {
  const FitParameterInfo* info = nullptr;
  double probability = 1;        // of such captures, or less likely ones, if its value is right
  double initial = 0;            // its value
  Eigen::VectorXd value, error;  // of its numbers, by one step to the optimum; with its prior
  double told = 0;               // their standard error by the captures alone, of a single number
  Eigen::VectorXd shift;         // (fitted parameters) by a step of 1 of a single number
};

// Score test: the gradient at the fitted values, with all that is not exact marginalised.
HeldTest testHeld(const FitParameterInfo& info, const CalibrationFit& fit) {
  const std::vector<ArmCaptures>& arms = fit.problem->arms();
  CalibrationOptions all = withAll(fit.problem->options(), arms);
  all.fit.insert(info.parameter);
  CalibrationProblem everything(arms, all);
  everything.setNumbers(numbersAmong(everything, *fit.problem));
  const std::vector<ParameterInfo>& infos = everything.parameters();
  const std::vector<int> fitted = placesAmong(infos, fit.problem->parameters());
  std::vector<int> own, others;
  for (int i = 0; i < static_cast<int>(infos.size()); ++i) {
    const bool is_own = infos[i].name.rfind(info.name, 0) == 0;
    (is_own ? own : others).push_back(i);
  }
  const CalibrationEquations& equations = everything.equations(fit.noise_scale);
  const Eigen::MatrixXd H = equations.hessian();
  const Eigen::MatrixXd cross = H(others, own);
  const Eigen::VectorXd& gradient = equations.gradient();
  const Eigen::LLT<Eigen::MatrixXd> rest(Eigen::MatrixXd(H(others, others)));
  const auto size = static_cast<Eigen::Index>(own.size());
  Eigen::VectorXd deviation(size);
  for (Eigen::Index i = 0; i < size; ++i) deviation[i] = infos[own[i]].deviation;
  // In units of the prior, whose own information is 1.
  const Eigen::MatrixXd posterior =
      deviation.asDiagonal() *
      (Eigen::MatrixXd(H(own, own)) - cross.transpose() * rest.solve(cross)).eval() *
      deviation.asDiagonal();
  const Eigen::VectorXd score =
      -deviation.cwiseProduct(gradient(own) - cross.transpose() * rest.solve(gradient(others)));
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> axes(posterior);
  HeldTest out;
  out.info = &info;
  double square = 0;
  int directions = 0;
  for (Eigen::Index j = 0; j < size; ++j) {
    const double information = axes.eigenvalues()[j] - 1;
    if (information < kLeastTold) continue;
    square += std::pow(axes.eigenvectors().col(j).dot(score), 2) / information;
    ++directions;
  }
  if (directions > 0) out.probability = tailOfF(square / directions, directions, fit.freedom);
  const ParameterInfo& first = infos[own.front()];
  const Eigen::MatrixXd covariance = inverseOf(posterior);
  out.initial = first.initial;
  out.value = deviation.cwiseProduct(covariance * score);
  out.error = deviation.cwiseProduct(covariance.diagonal().cwiseSqrt());
  if (first.logarithmic) {
    out.value = first.initial * out.value.array().exp();
    out.error = out.value.cwiseProduct(out.error);
  }
  out.told = deviation[0] / std::sqrt(std::max(posterior(0, 0) - 1, 0.0));
  out.shift = -fit.information.llt().solve(Eigen::VectorXd(H(fitted, own[0])));
  return out;
}

// Captures that do not tell the lengths hide their errors in the stiffness.
std::optional<std::string> warningOfLengths(const HeldTest& lengths, const CalibrationFit& fit,
                                            const std::vector<Parameter>& reported) {
  if (3 * lengths.told < kUsualLengthError) return std::nullopt;
  const std::vector<ParameterInfo>& infos = fit.problem->parameters();
  for (std::size_t i = 0; i < infos.size(); ++i) {
    const auto found = std::find_if(reported.begin(), reported.end(), [&](const Parameter& one) {
      return one.name == infos[i].name && one.identifiable;
    });
    if (found == reported.end() || !infos[i].logarithmic) continue;
    const double change =
        std::abs(lengths.shift[static_cast<Eigen::Index>(i)]) * kUsualLengthError * found->value;
    if (change <= found->standard_error) continue;
    return messageOf(
        "the standard error of ", infos[i].name,
        " takes the free lengths as exact, and the captures do not tell them: if they are "
        "off by ",
        100 * kUsualLengthError, " %, ", infos[i].name, " is off by ",
        std::round(100 * change / found->value), " %; fit length_scale as well, so that ",
        "the error says so, or contraction to measured free lengths");
  }
  return std::nullopt;
}

// Sum of the squared residuals of arms that are given otherwise, at the values of a fit.
double squaresOf(const std::vector<ArmCaptures>& arms, const CalibrationProblem& fitted) {
  CalibrationProblem problem(arms, fitted.options());
  problem.setNumbers(fitted.numbers());
  double sum = 0;
  for (const Comparison& one : problem.compare(1.0, false)) sum += one.square;
  return sum;
}

}  // namespace

bool isIdentified(const ParameterInfo& info, double variance) {
  const bool known = !info.logarithmic || variance <= kLargestRelativeError * kLargestRelativeError;
  return known && variance <= (1 - kLeastGain) * info.deviation * info.deviation;
}

CalibrationFit fitIdentified(const std::vector<ArmCaptures>& arms,
                             const CalibrationOptions& options, const HeldOutCheck& check) {
  // Keeps what the check left out with the fit.
  const auto isGood = [&](CalibrationFit& fit) {
    if (!fit.converged || !stiffnessIsIdentified(fit)) return false;
    fit.left_out = check(fit);
    return !fit.left_out || fit.left_out->holds_up;
  };
  CalibrationFit first = candidateOf(arms, options, options);
  if (!options.errors) return first;
  if (first.converged) first.asked.problem = first.problem;
  first.asked.noise_scale = first.noise_scale;
  const bool good = isGood(first);
  if (first.left_out) first.asked.left_out = first.left_out->jackknife;
  const std::vector<FitParameter> entries = freeStiffness(options);
  if (good || entries.empty()) return first;
  const std::vector<ParameterInfo> infos = first.problem->parameters();
  const auto hold = [&](CalibrationFit& fit, const std::vector<int>& fitted) {
    for (int e = 0; e < static_cast<int>(entries.size()); ++e) {
      const bool stays = std::find(fitted.begin(), fitted.end(), e) == fitted.end();
      if (stays) fit.held.push_back(heldParameter(infos[e]));
    }
  };
  const CalibrationFit::Asked asked = first.asked;
  // With all others fitted.
  const auto count = static_cast<Eigen::Index>(entries.size());
  const Eigen::MatrixXd marginal =
      statisticsOf(*first.problem, first.noise_scale).covariance.topLeftCorner(count, count);
  CalibrationFit last = std::move(first);
  for (const Split& split :
       splitsOf(inverseOf(marginal), options.stiffness_prior * options.stiffness_prior)) {
    CalibrationOptions fewer = options;
    for (const FitParameter one : entries) fewer.fit.erase(one);
    for (const int e : split.fitted) fewer.fit.insert(entries[static_cast<std::size_t>(e)]);
    if (fewer.fit.empty()) break;
    CalibrationFit fit = candidateOf(arms, fewer, options);
    fit.asked = asked;
    if (split.fitted.empty() || isGood(fit)) {
      hold(fit, split.fitted);
      if (split.fitted.empty() && fit.converged) fit.left_out = check(fit);
      return fit;
    }
    if (fit.converged || !last.converged) last = std::move(fit);
  }
  hold(last, {});
  return last;
}

Eigen::MatrixXd stiffnessErrors(const CalibrationFit& fit) {
  CalibrationProblem& asked = *fit.asked.problem;
  const auto entries = static_cast<Eigen::Index>(asked.stiffnessEntries().size());
  const Eigen::MatrixXd own = statisticsOf(asked, fit.asked.noise_scale).covariance;
  Eigen::MatrixXd covariance =
      withUncertaintyOfHeld(own, asked, asked.options(), fit.asked.noise_scale)
          .topLeftCorner(entries, entries);
  Eigen::VectorXd mean = (asked.numbers() - numbersAmong(asked, *fit.problem)).head(entries);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> axes(own.topLeftCorner(entries, entries));
  for (Eigen::Index j = 0; j < entries; ++j) {
    const double variance = axes.eigenvalues()[j];
    const Eigen::VectorXd axis = axes.eigenvectors().col(j);
    // Along one parameter there is no valley that could bend into others.
    const auto mixed = (axis.array().abs() >= kLeastMix).count();
    if (variance < kSharp * kSharp || mixed < 2) continue;
    const ValleySpread spread =
        spreadAlong(asked, fit.asked.noise_scale, axis, std::sqrt(variance));
    covariance += spread.covariance - variance * axis * axis.transpose();
    mean += spread.mean;
  }
  return covariance + mean * mean.transpose();
}

double usualScale(CalibrationProblem& fitted) {
  const std::vector<ArmCaptures>& read = fitted.arms();
  const CalibrationOptions& options = fitted.options();
  int residuals = 0;
  double least = 0, added = 0;
  for (const Comparison& one : fitted.compare(1.0, false)) {
    residuals += one.residuals;
    least += one.square;
  }
  const auto add = [&](const auto& shift) {
    for (const double sign : {1.0, -1.0}) {
      std::vector<ArmCaptures> shifted = read;
      for (ArmCaptures& arm : shifted) shift(sign, arm);
      const double change = squaresOf(shifted, fitted) - least;
      if (std::isfinite(change)) added += change / 2;
    }
  };
  const bool places = !options.fits(FitParameter::kTags) && isMet(FitNeed::kTags, fitted.kind());
  for (int axis = 0; axis < 3 && places; ++axis) {
    add([&](double sign, ArmCaptures& arm) {
      for (TagPlacement& tag : arm.layout.tags) {
        tag.X_ST.translation[axis] += sign * options.tag_prior.translation;
      }
    });
  }
  for (int i = 0; i < read.front().arm.actuatorCount() && !options.free_shapes; ++i) {
    add([&](double sign, ArmCaptures& arm) {
      if (i >= arm.arm.actuatorCount()) return;
      for (Capture& capture : arm.captures) {
        capture.pressure[i] += sign * kPressureError;
        capture.pressure = arm.arm.clamped(capture.pressure);
      }
    });
  }
  return std::sqrt(1 + std::max(0.0, added) / residuals);
}

CurveTest testCurve(const CalibrationFit& fit) {
  const auto deviation = fit.problem->blocks().of(ParameterBlock::kCurve);
  const Eigen::Index size = deviation.size(), all = fit.covariance.rows();
  const Eigen::MatrixXd by_noise = inverseOf(fit.information);
  const Eigen::VectorXd prior = fit.problem->priorInformation().head(all);
  const Eigen::MatrixXd by_captures =
      (by_noise - by_noise * prior.asDiagonal() * by_noise).bottomRightCorner(size, size);
  // The curve moves by what the free lengths leave open less what the captures leave open, and by
  // what is not fitted.
  const Eigen::MatrixXd moved = Eigen::MatrixXd::Identity(size, size) +
                                (fit.covariance - 2 * by_noise).bottomRightCorner(size, size);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> axes(moved);
  CurveTest out{0, 0, 1};
  double estimated = 0;  // share of the variance that comes from the noise of the captures
  for (Eigen::Index j = 0; j < size; ++j) {
    const double variance = axes.eigenvalues()[j];
    if (variance < kLeastTold) continue;
    const Eigen::VectorXd axis = axes.eigenvectors().col(j);
    out.chi_square += std::pow(axis.dot(deviation), 2) / variance;
    estimated += axis.dot(by_captures * axis) / variance;
    ++out.directions;
  }
  if (out.directions == 0) return out;
  estimated /= out.directions;
  // Welch's degrees of freedom, of a sum of which only this share is estimated.
  out.probability = tailOfF(out.chi_square / out.directions, out.directions,
                            fit.freedom / (estimated * estimated));
  return out;
}

std::vector<std::string> warningsOfHeld(const CalibrationOptions& asked, const CalibrationFit& fit,
                                        const std::vector<Parameter>& reported) {
  const std::vector<ArmCaptures>& arms = fit.problem->arms();
  std::vector<std::string> warnings;
  if (asked.free_shapes) return warnings;
  std::optional<HeldTest> doubted;
  for (const FitParameterInfo& info : fitParameters()) {
    if (!canBeFittedAsWell(info, arms, asked)) continue;
    const HeldTest test = testHeld(info, fit);
    if (test.probability < (doubted ? doubted->probability : kLeastProbability)) doubted = test;
    if (info.parameter != FitParameter::kLengthScale || arms.front().free_curve) continue;
    if (auto warning = warningOfLengths(test, fit, reported)) warnings.push_back(*warning);
  }
  if (!doubted) return warnings;
  const FitParameterInfo& info = *doubted->info;
  std::string values;
  if (doubted->value.size() == 1) {
    const std::string unit = info.numbers.front().unit;
    values = messageOf(std::setprecision(4), ", ", doubted->initial, unit.empty() ? "" : " ", unit,
                       ", and ask for ", doubted->value[0], " +- ", std::setprecision(2),
                       doubted->error[0]);
  }
  return {messageOf("the captures contradict the scene's ", info.word, values, std::setprecision(2),
                    " (probability, if it is right: ", doubted->probability, "): fit ", info.word,
                    " as well; values and standard errors take it as exact")};
}

}  // namespace helix_arm::estimation
