#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/calibration/calibration.hpp"
#include "helix_arm/calibration/series_fit.hpp"

namespace helix_arm::estimation {

/// A fault hypothesis, of a usual mistake, that would explain why a fit stays worse than the noise
/// of its data.
struct Suspect {
  /// channels_exchanged, channel_dead, pressure_unit, pressure_gain, pressure_offset,
  /// muscle_length, tags_turned, tag_rows_exchanged, tag_rows_reversed, tags_mirrored, tag_size,
  /// picture_size, picture_turned, base_moved, camera_moved, load or other_arm; of a series also
  /// tip_mirrored, quaternion_order, time_unit or frame_of_positions.
  std::string cause;
  std::string where;  ///< "muscle_1 and muscle_2", "all channels", "tags 4, 5 and 6"
  /// Share of the mean square beyond the noise of the readings, or beyond cubicError() of a series,
  /// in [0, 1]; 0 of other_arm, which is named where no mistake brings the readings near to this
  /// arm.
  double explains;
  std::string remedy;  ///< what to look at, and what to write into the scene
  /// The captures as they would be without the mistake, for a calibration with them. Empty if that
  /// takes another scene or another fit, as the remedy says.
  std::vector<ArmCaptures> corrected = {};
  std::optional<TipSeries> corrected_series = std::nullopt;  ///< likewise
  /// The tags as they would be on the arm, if the mistake is one of them: to write into the scene.
  std::optional<TagLayout> layout = std::nullopt;
};

/// Excess of a pressure beyond its limit, which counts as at it: regulators and their sensors are
/// not more accurate [Pa].
constexpr double kBeyondLimit = 10e3;

/// Residuals beyond so many times their noise are far from the fitted arm.
constexpr double kFarNoise = 5.0;

/// Whether one of them is taken for certain, so that nothing is written: it explains 0.9 of what is
/// beyond the noise, or 0.5 where the residuals are beyond kFarNoise.
/// @param noise  the residuals' scale, in expected deviations (Calibration::noise_scale).
bool isCertain(const std::vector<Suspect>& suspects, double noise);

/// Tries the usual mistakes of a rig, each with a fit of the requested parameters, and names those
/// that explain most of what the fit leaves beyond the noise, best first. The mistakes are those of
/// the first arm; the scene's limits bound what a pressure can have been.
///
/// @param arms, options  as given to calibrate(); captures whose pressures are outside the limits
///     are allowed, as in another unit.
/// @return at most 5, each of which explains 0.3 or more of what is beyond the noise. None if the
///     fit is as good as its noise, if calibrate() would refuse the captures for another reason
///     than their pressures, or if it was stopped.
/// @param stop  once it returns true, the search ends within the time of one fit.
std::vector<Suspect> suspectsOf(const std::vector<ArmCaptures>& arms,
                                const CalibrationOptions& options,
                                const std::function<bool()>& stop = {});

/// Tries the usual mistakes of a recorded series with short fits of the requested numbers, and
/// names at most 5 that explain 0.3 or more, best first.
std::vector<Suspect> suspectsOf(const SeriesPrior& prior, const TipSeries& series,
                                const SeriesOptions& options);

}  // namespace helix_arm::estimation
