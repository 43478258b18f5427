#include "calibration_statistics.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "helix_arm/basics/median.hpp"

namespace helix_arm::estimation {
namespace {

// The noise is found when a round changes it by less than this share; some rounds suffice.
constexpr double kNoiseSettled = 0.01;
constexpr int kMostRounds = 15;
// The expected noise counts as much as this many residuals.
constexpr double kNoisePrior = 1.0;
// Squares beyond so many limits of outliers say nothing of the noise.
constexpr double kGross = 2.0;
// Of the residuals, at least this share is taken to be free of parameters.
constexpr double kLeastFree = 0.1;
constexpr double kLeastVariance = 1e-12;

bool everyCapture(int) { return true; }

// The median of the squares of so many normal residuals (Wilson and Hilferty).
double medianSquare(int residuals) { return residuals * std::pow(1 - 2.0 / (9 * residuals), 3); }

// The noise that half of the residuals keep below, of the expected one: no minority moves it far.
double typicalNoise(const std::vector<Comparison>& comparisons, double data_parameters) {
  std::vector<double> sizes;
  double residuals = 0;
  for (const Comparison& one : comparisons) {
    sizes.push_back(std::sqrt(one.square / medianSquare(one.residuals)));
    residuals += one.residuals;
  }
  const double free = std::max(kLeastFree * residuals, residuals - data_parameters);
  // The median of a few may be far too small: Rousseeuw's factor for such.
  return basics::medianOf(std::move(sizes)) * std::sqrt(residuals / free) * (1 + 5 / free);
}

// The scale of the noise, of the expected one, that the residuals speak of.
double noiseScaleOf(const std::vector<Comparison>& comparisons, double data_parameters,
                    double scale) {
  // What counts as an outlier must not depend on how much the outliers add: from one in thirteen
  // on, each round would take in more of them.
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
  Eigen::MatrixXd all = problem.information(noise_scale, everyCapture);
  all.diagonal() += prior;
  const auto count = static_cast<Eigen::Index>(problem.parameters().size());
  Statistics out;
  out.information = all.topLeftCorner(count, count);
  // The readings of a capture see no shape but its own: eliminate one after the other.
  struct Shape {
    Eigen::MatrixXd covariance, by_rest;  // given the rest, and how the rest moves it
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
  // Trace of covariance and readings' information: all that the priors do not determine.
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
  // Placements that are not calibrated are off by far more than the noise: begin with what the
  // residuals are there, so that no reading is lost to the robust loss.
  std::vector<double> errors;
  for (const Comparison& one : problem.compare(1.0)) {
    if (std::isfinite(one.square)) errors.push_back(std::sqrt(one.square / one.residuals));
  }
  if (errors.empty()) return estimate;
  estimate.noise_scale = std::max(1.0, basics::medianOf(std::move(errors)));
  for (int round = 0; round < kMostRounds; ++round) {
    const double before = estimate.noise_scale;
    const Solved solved = problem.solve(before, everyCapture);
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
