#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

#include "basics/median.hpp"
#include "calibration_fit.hpp"

namespace helix_arm::estimation {
namespace {

// The noise has converged if an iteration changes it by less than this fraction.
constexpr double kNoiseSettled = 0.01;
constexpr int kMostRounds = 15;
// A rough solution ends once a step lowers the cost by less than this fraction. What is left then
// changes the noise by less than half as much; with much more, a few outliers could end as noise.
constexpr double kRoughTolerance = 1e-3;
// Weight of the expected noise, in residuals.
constexpr double kNoisePrior = 1.0;
// Squared residuals beyond this multiple of the outlier limit are ignored for the noise.
constexpr double kGross = 2.0;
// Minimum fraction of residuals that counts as degrees of freedom.
constexpr double kLeastFree = 0.1;
constexpr double kLeastVariance = 1e-12;
// Factor on the standard errors of free lengths while the noise of captures is estimated.
constexpr double kLooseCurve = 10.0;

// Median of the squared norm of this many standard normal residuals (Wilson and Hilferty).
double medianSquare(int residuals) { return residuals * std::pow(1 - 2.0 / (9 * residuals), 3); }

// Noise relative to the expected noise, from the median residual, which a minority of outliers
// hardly affects.
double typicalNoise(const std::vector<Comparison>& comparisons, double data_parameters) {
  std::vector<double> sizes;
  double residuals = 0;
  for (const Comparison& one : comparisons) {
    sizes.push_back(std::sqrt(one.square / medianSquare(one.residuals)));
    residuals += one.residuals;
  }
  const double free = std::max(kLeastFree * residuals, residuals - data_parameters);
  // The median of few residuals is biased low; Rousseeuw's factor corrects it.
  return basics::medianOf(std::move(sizes)) * std::sqrt(residuals / free) * (1 + 5 / free);
}

struct NoiseScale {
  double scale, freedom;
};

// Scale of the noise relative to the expected noise, estimated from the residuals.
NoiseScale noiseScaleOf(const std::vector<Comparison>& comparisons, double data_parameters,
                        double scale) {
  // The outlier limit must not depend on the outliers themselves: from one outlier in thirteen on,
  // each iteration would include more of them.
  const double typical =
      std::max(std::pow(typicalNoise(comparisons, data_parameters), 2), kLeastVariance);
  double weighted = 0, freedom = 0;
  for (const Comparison& one : comparisons) {
    const double excess = one.square / (one.limit * typical);
    if (excess > kGross) continue;
    const double weight = 1 / (1 + excess);
    weighted += weight * one.square;
    freedom += weight * one.residuals;
  }
  const double prior = kNoisePrior / (scale * scale);
  freedom = kNoisePrior + std::max(0.0, freedom - data_parameters);
  return {scale * std::sqrt((prior + weighted) / freedom), freedom};
}

// Number of free parameters that the readings determine: the trace of the covariance times their
// information, which is what the priors do not determine. Nothing if there is no covariance.
std::optional<double> dataParameters(CalibrationProblem& problem, double noise_scale) {
  CalibrationEquations& equations = problem.equations(noise_scale);
  const Eigen::VectorXd prior = problem.priorInformation();
  if (!equations.factor(Eigen::VectorXd::Zero(prior.size()))) return std::nullopt;
  return static_cast<double>(prior.size()) - equations.inverseTrace(prior);
}

// Captures that add less than this fraction of the others' information, or less than an absolute
// minimum, add nothing new.
constexpr double kNothingNew = 0.02;
constexpr double kLeastGainNats = 1e-3;
// Fractions of each actuator's range at which candidate captures are evaluated.
constexpr double kLevels[] = {0.0, 0.5, 1.0};
// Candidates of a symmetric arm differ by rounding alone: the first of them is taken [nats].
constexpr double kSameEntropy = 1e-9;
// Up to this many actuators, all combinations of levels are candidates; beyond, one actuator at a
// time and pairs.
constexpr int kMostCombined = 4;

// Columns of the parameters that affect the shape; all columns if none of these is fitted.
std::vector<int> shapeColumns(const std::vector<ParameterInfo>& infos) {
  std::vector<int> columns;
  for (std::size_t i = 0; i < infos.size(); ++i) {
    if (infos[i].about_shape) columns.push_back(static_cast<int>(i));
  }
  if (columns.empty()) {
    columns.resize(infos.size());
    std::iota(columns.begin(), columns.end(), 0);
  }
  return columns;
}

// Half the log determinant of the covariance of these columns.
double entropyOf(const Eigen::MatrixXd& information, const std::vector<int>& columns) {
  const Eigen::LLT<Eigen::MatrixXd> factors(information);
  if (factors.info() != Eigen::Success) return std::numeric_limits<double>::infinity();
  const Eigen::Index size = information.rows();
  const Eigen::MatrixXd units = Eigen::MatrixXd::Identity(size, size);
  const Eigen::MatrixXd solved = factors.solve(units(Eigen::all, columns));
  const Eigen::LLT<Eigen::MatrixXd> root(solved(columns, Eigen::all));
  return root.matrixLLT().diagonal().array().log().sum();
}

std::vector<Eigen::VectorXd> combinations(const model::Arm& arm) {
  const int n = arm.actuatorCount();
  std::vector<Eigen::VectorXd> out;
  std::vector<std::size_t> digits(n, 0);
  for (;;) {
    Eigen::VectorXd levels(n);
    for (int i = 0; i < n; ++i) levels[i] = kLevels[digits[i]];
    out.push_back(arm.inputAt(levels));
    int i = 0;
    while (i < n && ++digits[i] == std::size(kLevels)) digits[i++] = 0;
    if (i == n) return out;
  }
}

std::vector<Eigen::VectorXd> singlesAndPairs(const model::Arm& arm) {
  const int n = arm.actuatorCount();
  std::vector<Eigen::VectorXd> out;
  for (int i = 0; i < n; ++i) {
    for (int j = i; j < n; ++j) {
      for (const double level : kLevels) {
        Eigen::VectorXd levels = Eigen::VectorXd::Zero(n);
        levels[i] = levels[j] = level;
        out.push_back(arm.inputAt(levels));
      }
    }
  }
  return out;
}

}  // namespace

Statistics statisticsOf(CalibrationProblem& problem, double noise_scale) {
  CalibrationEquations& equations = problem.equations(noise_scale);
  const auto count = static_cast<Eigen::Index>(problem.parameters().size());
  if (problem.options().free_shapes) {
    equations.factor(Eigen::VectorXd::Zero(problem.priorInformation().size()));
    return {equations.reduced(), equations.reducedInverse()};
  }
  const Eigen::MatrixXd& information = equations.hessian();
  return {information, information.llt().solve(Eigen::MatrixXd::Identity(count, count))};
}

NoisySolution solveWithNoise(CalibrationProblem& problem, double bias, bool rough) {
  NoisySolution estimate;
  // Uncalibrated placements are off by far more than the noise, so the scale starts at the initial
  // residuals; otherwise the robust loss would discard all readings.
  std::vector<double> errors;
  for (const Comparison& one : problem.compare(1.0, false)) {
    if (std::isfinite(one.square)) errors.push_back(std::sqrt(one.square / one.residuals));
  }
  if (errors.empty()) return estimate;
  estimate.noise_scale = std::max(1.0, basics::medianOf(std::move(errors)));
  // Near its free lengths, a muscle leaves errors that are no noise of the captures, and that would
  // hide themselves by giving the captures less weight.
  const bool has_curve = isFree(problem.options(), ParameterBlock::kCurve);
  if (has_curve) problem.loosenCurve(kLooseCurve);
  // The noise that follows from a solution is known long before the solution is exact, so only the
  // rounds at the final noise are solved to the end.
  bool exact = false;
  double data_parameters = 0, counted_at = 0;
  for (int round = 0; round < kMostRounds; ++round) {
    exact = !rough && (exact || round + 1 == kMostRounds);
    const double before = estimate.noise_scale;
    const Solved solved =
        problem.solve(before, everyCapture, nullptr, exact ? kSolvedTolerance : kRoughTolerance);
    estimate.converged = solved.converged;
    estimate.cost = solved.cost;
    estimate.solved_scale = before;
    // They hardly change between a rough and an exact solution at one noise.
    if (before != counted_at) {
      const std::optional<double> counted = dataParameters(problem, before);
      if (!counted) return NoisySolution();
      data_parameters = *counted;
    }
    counted_at = before;
    const NoiseScale seen = noiseScaleOf(problem.compare(before, false), data_parameters, before);
    estimate.freedom = seen.freedom;
    const double now = std::hypot(seen.scale, bias);
    const bool settled = std::abs(now / before - 1) < kNoiseSettled;
    if (!settled || exact) estimate.noise_scale = now;
    if (settled && (exact || rough)) break;
    exact = settled;
  }
  if (has_curve) {
    problem.loosenCurve(1 / kLooseCurve);
    const Solved solved = problem.solve(estimate.noise_scale, everyCapture);
    estimate.converged = solved.converged;
    estimate.cost = solved.cost;
    estimate.solved_scale = estimate.noise_scale;
  }
  return estimate;
}

double standardErrorOf(const ParameterInfo& info, double value, double deviation) {
  return info.logarithmic ? std::abs(value) * deviation : deviation;
}

Gains gainsOf(const CalibrationFit& fit, const Groups& groups) {
  const std::vector<int> columns = shapeColumns(fit.problem->parameters());
  const double entropy = entropyOf(fit.information, columns);
  const int count = static_cast<int>(groups.pressure.size());
  Gains gains;
  double total = 0;
  for (int g = 0; g < count; ++g) {
    const Eigen::MatrixXd own = fit.problem->information(
        fit.noise_scale, [&groups, g](int capture) { return groups.of[capture] == g; });
    gains.of.push_back(entropyOf(fit.information - own, columns) - entropy);
    total += gains.of.back();
  }
  gains.least = std::max(kLeastGainNats, kNothingNew * total / count);
  return gains;
}

std::vector<Eigen::VectorXd> nextPressures(const CalibrationFit& fit) {
  const model::Arm& arm = fit.problem->arms().front().arm;
  const std::vector<int> columns = shapeColumns(fit.problem->parameters());
  const std::vector<Eigen::VectorXd> candidates =
      arm.actuatorCount() <= kMostCombined ? combinations(arm) : singlesAndPairs(arm);
  std::vector<Eigen::MatrixXd> says;
  for (const Eigen::VectorXd& pressure : candidates) {
    says.push_back(fit.problem->expectedInformation(pressure, fit.noise_scale));
  }
  Eigen::MatrixXd information = fit.information;
  std::vector<bool> taken(candidates.size(), false);
  std::vector<Eigen::VectorXd> out;
  while (static_cast<int>(out.size()) < fit.problem->options().next_pressures) {
    double least = std::numeric_limits<double>::infinity();
    std::size_t best = candidates.size();
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      if (taken[i]) continue;
      const double entropy = entropyOf(information + says[i], columns);
      if (entropy < least - kSameEntropy) {
        least = entropy;
        best = i;
      }
    }
    if (best == candidates.size()) break;
    out.push_back(candidates[best]);
    taken[best] = true;
    information += says[best];
  }
  return out;
}

}  // namespace helix_arm::estimation
