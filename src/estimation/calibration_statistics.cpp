#include "calibration_statistics.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "helix_arm/basics/median.hpp"

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
constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();

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
  ArrowEquations& equations = problem.equations(noise_scale);
  const Eigen::VectorXd prior = problem.priorInformation();
  if (!equations.factor(Eigen::VectorXd::Zero(prior.size()))) return std::nullopt;
  return static_cast<double>(prior.size()) -
         equations.inverseTrace(prior, equations.reducedInverse());
}

}  // namespace

Statistics statisticsOf(CalibrationProblem& problem, double noise_scale) {
  ArrowEquations& equations = problem.equations(noise_scale);
  const auto count = static_cast<Eigen::Index>(problem.parameters().size());
  Statistics out;
  const Eigen::MatrixXd none = Eigen::MatrixXd::Constant(count, count, kNoNumber);
  if (problem.selection().free_shapes) {
    out.determined = equations.factor(Eigen::VectorXd::Zero(problem.priorInformation().size()));
    out.information = out.determined ? equations.reduced() : none;
    out.covariance = out.determined ? Eigen::MatrixXd(equations.reducedInverse()) : none;
    return out;
  }
  out.information = equations.dense();
  const Eigen::LLT<Eigen::MatrixXd> root(out.information);
  out.determined = root.info() == Eigen::Success;
  out.covariance =
      out.determined ? root.solve(Eigen::MatrixXd::Identity(count, count)).eval() : none;
  return out;
}

Estimate solveWithNoise(CalibrationProblem& problem, double bias) {
  Estimate estimate;
  // Uncalibrated placements are off by far more than the noise, so the scale starts at the initial
  // residuals; otherwise the robust loss would discard all readings.
  std::vector<double> errors;
  for (const Comparison& one : problem.compareSquares(1.0)) {
    if (std::isfinite(one.square)) errors.push_back(std::sqrt(one.square / one.residuals));
  }
  if (errors.empty()) return estimate;
  estimate.noise_scale = std::max(1.0, basics::medianOf(std::move(errors)));
  // Near its free lengths, a muscle leaves errors that are no noise of the captures, and that would
  // hide themselves by giving the captures less weight.
  const bool has_curve = problem.selection().has(ParameterBlock::kCurve);
  if (has_curve) problem.loosenCurve(kLooseCurve);
  // The noise that follows from a solution is known long before the solution is exact, so only the
  // rounds at the final noise are solved to the end.
  bool exact = false;
  double data_parameters = 0, counted_at = 0;
  for (int round = 0; round < kMostRounds; ++round) {
    exact = exact || round + 1 == kMostRounds;
    const double before = estimate.noise_scale;
    const Solved solved =
        problem.solve(before, everyCapture, nullptr, exact ? kSolvedTolerance : kRoughTolerance);
    estimate.converged = solved.converged;
    estimate.cost = solved.cost;
    estimate.solved_scale = before;
    // They hardly change between a rough and an exact solution at one noise.
    if (before != counted_at) {
      const std::optional<double> counted = dataParameters(problem, before);
      estimate.determined = counted.has_value();
      if (!estimate.determined) break;
      data_parameters = *counted;
    }
    counted_at = before;
    const NoiseScale seen = noiseScaleOf(problem.compareSquares(before), data_parameters, before);
    estimate.freedom = seen.freedom;
    const double now = std::hypot(seen.scale, bias);
    const bool settled = std::abs(now / before - 1) < kNoiseSettled;
    if (!settled || exact) estimate.noise_scale = now;
    if (settled && exact) break;
    exact = settled;
  }
  if (has_curve) {
    problem.loosenCurve(1 / kLooseCurve);
    const Solved solved = problem.solve(estimate.noise_scale, everyCapture);
    estimate.converged = solved.converged;
    estimate.cost = solved.cost;
    estimate.solved_scale = estimate.noise_scale;
  }
  estimate.converged = estimate.converged && estimate.determined;
  return estimate;
}

double standardErrorOf(const ParameterInfo& info, double value, double deviation) {
  return info.logarithmic ? std::abs(value) * deviation : deviation;
}

}  // namespace helix_arm::estimation
