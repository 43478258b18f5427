#pragma once

#include <optional>
#include <vector>

#include "helix_arm/estimation/twist_fit.hpp"

/// What the residuals of a twist fit say: which tags do not fit, and how large the noise is.
/// `squares` are the squared residuals of the fit's tags, in expected variances.
namespace helix_arm::estimation {

/// Marks the tags whose squares are beyond a limit as outliers, and sets the RMS of the others.
/// @return how many those are.
int markOutliers(const std::vector<double>& squares, double limit, TwistFit& fit);

/// Factor that the expected errors of tags are to grow by; nothing where their errors are about as
/// large as expected. Limited: tags that are off by much more are wrong, however many they are.
/// @param residuals  of a tag. @param errors  work space.
std::optional<double> noiseScaleOf(const std::vector<double>& squares, double residuals,
                                   std::vector<double>& errors);

/// Noise that the residuals show.
struct ResidualNoise {
  double variance;  ///< in expected ones
  double freedom;   ///< residuals that it is from, beyond those that the parameters take
};

/// Noise of errors of normal distribution under a loss that weighs them (Huber, Robust Statistics,
/// 7.6): the squares that count over the slopes of the equations, by which larger errors count
/// less.
/// @param residuals  of a tag. @param data_parameters  parameters that the tags determine.
ResidualNoise noiseOf(const TwistFit& fit, const std::vector<double>& squares, double residuals,
                      double data_parameters);

}  // namespace helix_arm::estimation
