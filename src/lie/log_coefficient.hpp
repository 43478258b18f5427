#pragma once

namespace helix_arm::lie {

/// theta^2 [rad^2] from which a quotient serves and below which a series does, as the quotient
/// would cancel.
inline constexpr double kLogSeriesLimit = 2.0;

/// (1 - (theta/2) cot(theta/2)) / theta^2 at x = theta^2 [rad^2], the coefficient of [w]^2 in V^-1.
/// Infinite where theta = 2 pi k, k > 0.
double logCoefficient(double x);

/// The same with its change by x.
struct LogCoefficient {
  double value;
  double slope;  ///< [1/rad^2]
};
LogCoefficient logCoefficientAndSlope(double x);

}  // namespace helix_arm::lie
