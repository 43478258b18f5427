#include "fit_noise.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace helix_arm::estimation {
namespace {

// If the median error exceeds the expected error by more than this factor, the expected error is
// raised in proportion, up to a limit: larger errors are outliers, however many there are.
constexpr double kNoisy = 1.5;
constexpr double kMostNoise = 7.0;
// Minimum degrees of freedom; missing ones are filled with residuals of the expected size.
constexpr double kLeastFreedom = 4.0;
// Lower bound of the estimated variance, relative to the expected one.
constexpr double kLeastVariance = 0.01;

}  // namespace

int markOutliers(const std::vector<double>& squares, double limit, TwistFit& fit) {
  double square = 0;
  int fitting = 0;
  for (std::size_t i = 0; i < fit.tags.size(); ++i) {
    TagResidual& tag = fit.tags[i];
    tag.outlier = squares[i] > limit;
    if (tag.outlier) continue;
    square += tag.rms * tag.rms;
    ++fitting;
  }
  fit.rms = fitting > 0 ? std::sqrt(square / fitting) : 0;
  return fitting;
}

std::optional<double> noiseScaleOf(const std::vector<double>& squares, double residuals,
                                   std::vector<double>& errors) {
  errors.clear();
  for (const double square : squares) errors.push_back(std::sqrt(square / residuals));
  const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
  std::nth_element(errors.begin(), middle, errors.end());
  if (*middle < kNoisy) return std::nullopt;
  return std::min(*middle / kNoisy, kMostNoise);
}

ResidualNoise noiseOf(const TwistFit& fit, const std::vector<double>& squares, double residuals,
                      double data_parameters) {
  double weights = 0, weights2 = 0, weighted = 0, slopes = 0, slopes2 = 0;
  for (std::size_t i = 0; i < fit.tags.size(); ++i) {
    const double weight = fit.tags[i].weight;
    const double radial = weight * (2 * weight - 1);  // across it, the slope is the weight
    weights += weight;
    weights2 += weight * weight;
    weighted += weight * weight * squares[i];
    slopes += (residuals - 1) * weight + radial;
    slopes2 += (residuals - 1) * weight * weight + radial * radial;
  }
  const double all = residuals * static_cast<double>(fit.tags.size());
  // Tags of weight 0 do not count.
  const double count = residuals * weights * weights / weights2;
  const double freedom = std::max(0.0, count - data_parameters);
  const double spread = all * slopes2 / (slopes * slopes) - 1;
  const double correction = 1 + data_parameters / all * spread;
  const double square =
      correction * correction * weighted * count * residuals * weights / (slopes * slopes);
  const double expected = std::max(0.0, kLeastFreedom - freedom);
  return {std::max(kLeastVariance, (expected + square) / (expected + freedom)), expected + freedom};
}

}  // namespace helix_arm::estimation
