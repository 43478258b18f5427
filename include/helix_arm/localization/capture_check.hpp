#pragma once

#include <optional>
#include <vector>

#include "helix_arm/localization/twist_fit.hpp"

/// Captures whose tags agree with no shape of the arm, although no single tag is at fault.
namespace helix_arm::estimation {

/// Residuals of a capture beyond this multiple of the usual ones are no noise.
constexpr double kApart = 3.0;

/// How a shape that was fitted to a capture agrees with its tags.
struct CaptureScatter {
  double rms;      ///< over the tags that fit [m or px]
  double freedom;  ///< their residuals less the fitted parameters; captures with none do not count
  double residuals;
};
/// @param per_tag  residuals of a tag: 3 of a position, 8 of corners.
CaptureScatter scatterOf(const TwistFit& fit, int per_tag, bool planar);

/// Which captures of a data set fit worse than the others.
struct CaptureCheck {
  /// Median of the captures' RMS; absent with fewer than 5 captures, which tell nothing.
  std::optional<double> usual;
  std::vector<bool> apart;  ///< (captures) those whose residuals are too large for their number
};
/// Compares captures with their median, which a minority of wrong ones hardly affects.
/// @param captures  those that have no fit are absent.
CaptureCheck checkCaptures(const std::vector<std::optional<CaptureScatter>>& captures);

}  // namespace helix_arm::estimation
