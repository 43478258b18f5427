#pragma once

#include <optional>
#include <vector>

#include "helix_arm/estimation/twist_fit.hpp"

/// Outliers and noise from the residuals of a twist fit. `squares` are the squared residuals of the
/// fit's tags, in expected variances.
namespace helix_arm::estimation {

/// Marks tags whose squares exceed a limit as outliers, and sets the RMS of the others.
/// @return the number of the others.
int markOutliers(const std::vector<double>& squares, double limit, TwistFit& fit);

/// Factor by which the expected errors of tags must grow; empty if the errors are about as large as
/// expected. The factor is limited: tags with much larger errors are wrong, however many they are.
/// @param residuals  number per tag. @param errors  workspace.
std::optional<double> noiseScaleOf(const std::vector<double>& squares, double residuals,
                                   std::vector<double>& errors);

/// Noise estimated from the residuals.
struct ResidualNoise {
  double variance;  ///< in expected variances
  double freedom;   ///< number of residuals in excess of the fitted parameters
};

/// Noise of normally distributed errors under a robust loss (Huber, Robust Statistics, 7.6): the
/// weighted squares divided by the slopes of the equations, since larger errors have less weight.
/// @param residuals  number per tag. @param data_parameters  number of parameters that the tags
///     determine.
ResidualNoise noiseOf(const TwistFit& fit, const std::vector<double>& squares, double residuals,
                      double data_parameters);

}  // namespace helix_arm::estimation
