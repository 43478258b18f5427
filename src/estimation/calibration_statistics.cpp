#include "calibration_statistics.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "helix_arm/basics/median.hpp"

namespace helix_arm::estimation {
namespace {

// The noise has converged if an iteration changes it by less than this fraction.
constexpr double kNoiseSettled = 0.01;
constexpr int kMostRounds = 15;
// Weight of the expected noise, in residuals.
constexpr double kNoisePrior = 1.0;
// Squared residuals beyond this multiple of the outlier limit are ignored for the noise.
constexpr double kGross = 2.0;
// Minimum fraction of residuals that counts as degrees of freedom.
constexpr double kLeastFree = 0.1;
constexpr double kLeastVariance = 1e-12;

bool eachCapture(int) { return true; }

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

// Scale of the noise relative to the expected noise, estimated from the residuals.
double noiseScaleOf(const std::vector<Comparison>& comparisons, double data_parameters,
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
  const double variance =
      (prior + weighted) / (kNoisePrior + std::max(0.0, freedom - data_parameters));
  return scale * std::sqrt(variance);
}

}  // namespace

Statistics statisticsOf(CalibrationProblem& problem, double noise_scale) {
  const Eigen::VectorXd prior = problem.priorInformation();
  Eigen::MatrixXd all = problem.information(noise_scale, eachCapture);
  all.diagonal() += prior;
  const auto count = static_cast<Eigen::Index>(problem.parameters().size());
  Statistics out;
  out.information = all.topLeftCorner(count, count);
  // Readings of a capture depend on no other capture's shape, so shapes are eliminated one by one.
  struct Shape {
    Eigen::MatrixXd covariance, by_rest;  // given the rest, and the derivative by the rest
    Eigen::Index first;
  };
  std::vector<Shape> shapes;
  Eigen::Index first = count;
  for (const int size : problem.shapeSizes()) {
    const Eigen::LLT<Eigen::MatrixXd> factors(all.block(first, first, size, size));
    const auto cross = all.block(first, 0, size, count);
    shapes.push_back(
        {factors.solve(Eigen::MatrixXd::Identity(size, size)), factors.solve(cross), first});
    out.information.noalias() -= cross.transpose() * shapes.back().by_rest;
    first += size;
  }
  out.covariance =
      Eigen::LLT<Eigen::MatrixXd>(out.information).solve(Eigen::MatrixXd::Identity(count, count));
  // Trace of covariance times information of the readings: what the priors do not determine.
  double held = out.covariance.diagonal().dot(prior.head(count));
  for (const Shape& shape : shapes) {
    const Eigen::VectorXd variances =
        shape.covariance.diagonal() +
        (shape.by_rest * out.covariance).cwiseProduct(shape.by_rest).rowwise().sum();
    held += variances.dot(prior.segment(shape.first, variances.size()));
  }
  out.data_parameters = static_cast<double>(all.rows()) - held;
  return out;
}

Estimate solveWithNoise(CalibrationProblem& problem, double bias) {
  Estimate estimate;
  // Uncalibrated placements are off by far more than the noise, so the scale starts at the initial
  // residuals; otherwise the robust loss would discard all readings.
  std::vector<double> errors;
  for (const Comparison& one : problem.compare(1.0)) {
    if (std::isfinite(one.square)) errors.push_back(std::sqrt(one.square / one.residuals));
  }
  if (errors.empty()) return estimate;
  estimate.noise_scale = std::max(1.0, basics::medianOf(std::move(errors)));
  for (int round = 0; round < kMostRounds; ++round) {
    const double before = estimate.noise_scale;
    const Solved solved = problem.solve(before, eachCapture);
    estimate.converged = solved.converged;
    estimate.cost = solved.cost;
    estimate.solved_scale = before;
    const Statistics statistics = statisticsOf(problem, before);
    const double seen = noiseScaleOf(problem.compare(before), statistics.data_parameters, before);
    estimate.noise_scale = std::hypot(seen, bias);
    if (std::abs(estimate.noise_scale / before - 1) < kNoiseSettled) break;
  }
  return estimate;
}

double standardErrorOf(const ParameterInfo& info, double value, double deviation) {
  return info.logarithmic ? std::abs(value) * deviation : deviation;
}

}  // namespace helix_arm::estimation
