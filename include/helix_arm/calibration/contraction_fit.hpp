#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/model/contraction.hpp"

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

/// One length reading of an unloaded muscle.
struct LengthSample {
  double pressure;  ///< gauge [Pa]
  double length;    ///< [m]
};

/// How a curve is written.
enum class CurveKind {
  kQuintic,  ///< one polynomial over p / p_ref, as in the paper; from 0 to the largest pressure
  kTable,    ///< monotone piecewise cubic (PCHIP) from the smallest to the largest pressure
  kSpline,   ///< ContractionSpline over the same range, as a table of close points
};

/// Which samples are used. A sample is on the rising branch if the pressure rose to it or rises
/// from it, and on the falling branch if it fell or falls; a turning point is on both. Changes
/// within 1 % of the largest pressure are ignored.
enum class Branch { kBoth, kRising, kFalling };

/// Which curve is fitted, and to which readings.
struct ContractionFitOptions {
  CurveKind kind = CurveKind::kQuintic;
  Branch branch = Branch::kBoth;
};

/// Fitted free length as a function of pressure.
struct ContractionFit {
  std::string reason;  ///< cause and remedy; empty if fitted
  CurveKind kind = CurveKind::kQuintic;
  /// Strictly monotone on its range; absent if the fit failed.
  std::optional<model::Contraction> curve;
  // In the form of a scene file.
  std::array<double, 6> coefficients = {};  ///< of a quintic, over p / p_ref [m]
  double reference_pressure = 0;            ///< p_ref, also the upper end of the range [Pa]
  std::vector<double> pressures, lengths;   ///< of a table or a spline [Pa], [m]
  std::optional<ContractionSpline> spline;  ///< of a spline, before it was held monotone

  double rms = 0;            ///< of the residuals [m]
  Eigen::VectorXd residual;  ///< (samples) curve - sample [m]; 0 for samples of the other branch
  /// True if the best unconstrained curve is not monotone on its range, or has less than a
  /// thousandth of the mean slope somewhere. This curve is then the best of those that have at
  /// least that slope everywhere.
  bool constrained = false;
  /// Difference in length of the muscle between the rising and the falling branch [m]: the
  /// difference of the medians of their deviations from the curve, without turning points. Absent
  /// if only one branch was measured.
  std::optional<double> hysteresis;
};

/// Least squares under the constraint that the curve is strictly monotone on its range. It falls or
/// rises like a line through the samples: muscles shorten, bellows lengthen.
///
/// A quintic needs 6 distinct pressures, the least of them within 5 % of the largest from 0; other
/// curves need 2. The slope of the line must be at least 2 of its standard errors.
///
/// @param samples  in measured order, with any number at one pressure. Pressures within 1e-6 of the
///     largest count as equal.
ContractionFit fitContraction(const std::vector<LengthSample>& samples,
                              const ContractionFitOptions& options = {});

/// The monotone curve of a spline that was found otherwise, compared with the same samples.
ContractionFit contractionOf(const ContractionSpline& spline,
                             const std::vector<LengthSample>& samples, Branch branch);

}  // namespace helix_arm::estimation
