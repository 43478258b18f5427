#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/model/contraction.hpp"

namespace helix_arm::estimation {

/// One reading of a muscle that carries nothing.
struct LengthSample {
  double pressure;  ///< gauge [Pa]
  double length;    ///< [m]
};

enum class CurveKind {
  kQuintic,  ///< one polynomial over p / p_ref, as in the paper; from 0 to the largest pressure
  kTable,    ///< monotone piecewise cubic (PCHIP) from the smallest to the largest pressure
};

/// Which samples count. A sample is on the rising branch when the pressure rose to it or rises from
/// it, on the falling branch when it fell or falls: where it turned, on both. Moves within 1 % of
/// the largest pressure are none.
enum class Branch { kBoth, kRising, kFalling };

struct ContractionFitOptions {
  CurveKind kind = CurveKind::kQuintic;
  Branch branch = Branch::kBoth;
};

enum class ContractionFitStatus {
  kFitted,
  kTooFewPressures,  ///< fewer that differ than a curve of its kind needs, 6 or 2, on the branch
  kNotFinite,        ///< a sample is not finite, or its length not > 0
  kOutOfRange,  ///< a pressure or a fitted length below 0, or, for a quintic, no pressure within
                ///< 5 % of the largest from 0: nothing says where the curve begins
  kNoTrend,     ///< lengths neither rise nor fall with pressure: a line through them slopes by
                ///< less than 2 of its standard errors
};

/// Free length against pressure, fitted.
struct ContractionFit {
  ContractionFitStatus status = ContractionFitStatus::kTooFewPressures;
  std::string reason;  ///< culprit and remedy; empty where fitted
  CurveKind kind = CurveKind::kQuintic;
  /// Strictly monotone on its range; absent where the fit failed.
  std::optional<model::Contraction> curve;
  // As a scene file has it.
  std::array<double, 6> coefficients = {};  ///< of a quintic, over p / p_ref [m]
  double reference_pressure = 0;            ///< p_ref, also the end of its range [Pa]
  std::vector<double> pressures, lengths;   ///< of a table [Pa], [m]

  double rms = 0;            ///< of the residuals [m]
  Eigen::VectorXd residual;  ///< (samples) curve - sample [m]; 0 for those of the other branch
  /// The best curve of this kind turns back on its range, or has less than a thousandth of the mean
  /// slope somewhere: this one is the best of those that have it everywhere.
  bool constrained = false;
  /// How much longer the muscle is on the rising branch than on the falling one [m]: the difference
  /// of the medians of their distances from the curve, without the samples where the pressure
  /// turned. Absent where only one branch was measured.
  std::optional<double> hysteresis;
};

/// Least squares under the constraint that the curve is strictly monotone on its range. It falls or
/// rises as a line through the samples does: muscles shorten, bellows lengthen.
///
/// @param samples  in the order they were taken; any number at one pressure. Pressures within
///                 1e-6 of the largest are one.
ContractionFit fitContraction(const std::vector<LengthSample>& samples,
                              const ContractionFitOptions& options = {});

}  // namespace helix_arm::estimation
