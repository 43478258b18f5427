#include "helix_arm/estimation/contraction_spline.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>

namespace helix_arm::estimation {
namespace {

// Enough for the curves of braided muscles; more would follow the noise of single readings.
constexpr int kMostKnots = 7;

// Second derivatives at the knots by the lengths there; 0 at both ends.
Eigen::MatrixXd bendsOf(const std::vector<double>& knots) {
  const auto n = static_cast<Eigen::Index>(knots.size());
  Eigen::MatrixXd left = Eigen::MatrixXd::Identity(n, n), right = Eigen::MatrixXd::Zero(n, n);
  for (Eigen::Index i = 1; i + 1 < n; ++i) {
    const double before = knots[i] - knots[i - 1], after = knots[i + 1] - knots[i];
    left.row(i).segment<3>(i - 1) << before / 6, (before + after) / 3, after / 6;
    right.row(i).segment<3>(i - 1) << 1 / before, -1 / before - 1 / after, 1 / after;
  }
  return left.partialPivLu().solve(right);
}

std::vector<double> quantilesOf(const std::vector<double>& pressures) {
  const std::size_t count = std::min<std::size_t>(kMostKnots, pressures.size());
  std::vector<double> knots;
  for (std::size_t k = 0; k < count; ++k) {
    const double place =
        static_cast<double>(k * (pressures.size() - 1)) / static_cast<double>(count - 1);
    const auto below = std::min(static_cast<std::size_t>(place), pressures.size() - 2);
    const double share = place - static_cast<double>(below);
    knots.push_back((1 - share) * pressures[below] + share * pressures[below + 1]);
  }
  return knots;
}

}  // namespace

Eigen::RowVectorXd ContractionSpline::weights(double pressure) const {
  const auto above = std::upper_bound(knots.begin() + 1, knots.end() - 1, pressure);
  const Eigen::Index i = above - knots.begin() - 1;
  const double h = knots[i + 1] - knots[i];
  const double b = (pressure - knots[i]) / h, a = 1 - b;
  const Eigen::MatrixXd bends = bendsOf(knots);
  Eigen::RowVectorXd out =
      h * h / 6 * ((a * a * a - a) * bends.row(i) + (b * b * b - b) * bends.row(i + 1));
  out[i] += a;
  out[i + 1] += b;
  return out;
}

ContractionSpline fitSpline(const std::vector<double>& pressures,
                            const std::vector<double>& lengths,
                            const std::vector<double>& weights) {
  ContractionSpline spline;
  spline.knots = quantilesOf(pressures);
  const auto n = static_cast<Eigen::Index>(spline.knots.size());
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
  for (std::size_t i = 0; i < pressures.size(); ++i) {
    const Eigen::RowVectorXd row = spline.weights(pressures[i]);
    information += weights[i] * row.transpose() * row;
    right += weights[i] * lengths[i] * row.transpose();
  }
  const Eigen::LLT<Eigen::MatrixXd> factors(information);
  spline.lengths = factors.solve(right);
  // The inverse of the factor L': its product with its transpose is the inverse of L L'.
  spline.root = kFreeLengthNoise * factors.matrixU().solve(Eigen::MatrixXd::Identity(n, n));
  return spline;
}

}  // namespace helix_arm::estimation
