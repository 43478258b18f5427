#pragma once

#include <Eigen/Core>
#include <vector>

/// Natural cubic splines of an actuator's free length over its pressure. They depend linearly on
/// their lengths at the knots, so that free lengths and captures of an arm can determine them
/// together.
namespace helix_arm::estimation {

/// Expected standard deviation of a measured free length [m].
constexpr double kFreeLengthNoise = 0.001;

/// A spline, and how far the free lengths determine it.
struct ContractionSpline {
  std::vector<double> knots;  ///< ascending pressures, 2 or more [Pa]
  Eigen::VectorXd lengths;    ///< at the knots [m]
  /// Root of their covariance, (knots x knots): lengths + root * z, z of unit variance [m].
  Eigen::MatrixXd root;

  /// Weights of the lengths at the knots in the length at a pressure within the knots.
  Eigen::RowVectorXd weights(double pressure) const;
  /// Standard error of the length at a pressure [m].
  double errorAt(double pressure) const { return (weights(pressure) * root).norm(); }
};

/// Least squares of lengths of unit weight kFreeLengthNoise, with up to 7 knots at quantiles of the
/// pressures.
///
/// @param pressures  ascending and distinct, 2 or more [Pa].
/// @param weights  numbers of samples at these pressures.
ContractionSpline fitSpline(const std::vector<double>& pressures,
                            const std::vector<double>& lengths, const std::vector<double>& weights);

}  // namespace helix_arm::estimation
