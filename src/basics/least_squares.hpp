#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

/// Dense least squares within bounds (Levenberg and Marquardt), outside of hot loops, and how much
/// the readings of a series count.
namespace helix_arm::basics {

/// Normal equations of half the cost about an estimate: H = J'WJ and g = J'Wr of residuals r with
/// weights W.
struct DenseEquations {
  Eigen::MatrixXd hessian;
  Eigen::VectorXd gradient;

  /// Parameter k keeps its value: it is at a bound that it would leave, or has no effect.
  void hold(Eigen::Index k) {
    hessian.row(k).setZero();
    hessian.col(k).setZero();
    gradient[k] = 0;
  }
};

/// How a descent damps its steps, and where it ends.
struct DescentRules {
  double first_damping;  ///< lambda of the first step
  double damping_fall;   ///< divides lambda after a step
  double most_damping;   ///< ends where only a larger lambda might lower the cost
  /// Ends after a step that lowers the cost c by at most relative_decrease c + least_decrease.
  double relative_decrease, least_decrease;
  int max_iterations;
};

template <class Estimate>
struct Descended {
  Estimate at;
  double cost = 0.0;  ///< there; the search does not begin if it is not finite
  int iterations = 0;
  bool at_rest = false;  ///< ended by the decrease of the cost
};

/// Takes steps dx from an estimate that do not raise its cost:
///     (H + lambda D) dx = -g,   D = diag(H), but lambda D = 1 where a parameter is held.
/// The damping lambda rises until one does not, and falls after it.
///
/// @param problem  has cost(estimate), linearise(estimate) -> DenseEquations, and
///     moved(estimate, dx) -> Estimate, which respects the bounds.
template <class Problem, class Estimate>
Descended<Estimate> descend(const Problem& problem, Estimate start, const DescentRules& rules) {
  constexpr double kDampingRise = 10.0, kLeastDamping = 1e-9;
  const double start_cost = problem.cost(start);
  Descended<Estimate> out{std::move(start), start_cost};
  if (!std::isfinite(out.cost)) return out;
  double damping = rules.first_damping;
  while (out.iterations < rules.max_iterations && damping < rules.most_damping && !out.at_rest) {
    ++out.iterations;
    const DenseEquations equations = problem.linearise(out.at);
    for (; damping < rules.most_damping; damping *= kDampingRise) {
      Eigen::MatrixXd damped = equations.hessian;
      for (double& entry : damped.diagonal()) entry = entry > 0 ? entry * (1 + damping) : 1.0;
      Estimate next = problem.moved(out.at, -damped.ldlt().solve(equations.gradient));
      const double cost = problem.cost(next);
      if (!(cost <= out.cost)) continue;
      out.at_rest = out.cost - cost <= rules.relative_decrease * out.cost + rules.least_decrease;
      out.at = std::move(next);
      out.cost = cost;
      damping = std::max(damping / rules.damping_fall, kLeastDamping);
      break;
    }
  }
  return out;
}

/// Factor by which deviations that are correlated in time raise the variance of what is fitted to
/// them, >= 1: 1 + 2 sum rho_k of the correlations at k rows, as long as they are > 0, in steps of
/// an eighth of k. A drift below noise shows in this sum, but hardly in the first correlation.
/// @param deviation  (rows x outputs).
/// @param trial  (rows) equal numbers for rows of one trial; others count as unrelated.
inline double correlationFactor(const Eigen::MatrixXd& deviation, const std::vector<int>& trial) {
  const double square = deviation.squaredNorm();
  double factor = 1.0;
  for (Eigen::Index lag = 1, step = 1; lag < deviation.rows() && square > 0; lag += step) {
    double product = 0;
    for (Eigen::Index k = lag; k < deviation.rows(); ++k) {
      const bool related =
          trial[static_cast<std::size_t>(k)] == trial[static_cast<std::size_t>(k - lag)];
      if (related) product += deviation.row(k).dot(deviation.row(k - lag));
    }
    if (product <= 0) break;
    step = std::max<Eigen::Index>(1, lag / 8);
    factor += 2 * static_cast<double>(step) * product / square;
  }
  return factor;
}

}  // namespace helix_arm::basics
