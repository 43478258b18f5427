#pragma once

namespace helix_arm::lie {

/// theta^2 [rad^2] from which a quotient is used. Below, a series is used, since the quotient
/// suffers from cancellation.
inline constexpr double kLogSeriesLimit = 2.0;

/// (1 - (theta/2) cot(theta/2)) / theta^2 at x = theta^2 [rad^2], the coefficient of [w]^2 in V^-1.
/// Infinite where theta = 2 pi k, k > 0.
double logCoefficient(double x);

/// logCoefficient() and its derivative with respect to x.
struct LogCoefficient {
  double value;
  double slope;  ///< [1/rad^2]
};
LogCoefficient logCoefficientAndSlope(double x);

/// Its second derivative with respect to x [1/rad^4].
double logCoefficientCurvature(double x);

}  // namespace helix_arm::lie
