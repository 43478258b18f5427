#pragma once

#include <Eigen/Core>

namespace helix_arm::estimation {

/// A normally distributed vector, and the update of a Kalman filter.
struct Gaussian {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;

  /// A measurement of it: value = H mean + noise.
  struct Measurement {
    Eigen::VectorXd innovation;  ///< (d) measured minus expected value
    Eigen::MatrixXd H;           ///< (d x size)
    Eigen::MatrixXd noise;       ///< (d x d) covariance
  };

  /// Squared Mahalanobis distance of an innovation, nu' S^-1 nu, with S = H P H' + R.
  double distance2(const Measurement& measurement) const;
  /// Logarithm of the likelihood of an innovation, log N(nu; 0, S).
  double logLikelihood(const Measurement& measurement) const;
  /// Takes the measurement, in Joseph's form.
  /// @param held  the first `held` entries of the mean stay; what they may be wrong by still
  /// counts.
  void update(const Measurement& measurement, Eigen::Index held = 0);
};

/// Probability of a ratio at least as large of two variances of normal numbers, F with `above` and
/// `below` degrees of freedom (Paulson; Abramowitz and Stegun, 26.6.15).
///
/// @param ratio  >= 0. With an infinite `below`, a chi-square over `above`; with `above` 1, t^2 of
/// a
///     test of both sides.
/// @param below  >= 1; for 4 and more, tails of 0.1 % and more are right to a fifth of their size.
double tailOfF(double ratio, double above, double below);

}  // namespace helix_arm::estimation
