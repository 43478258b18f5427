#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "captures.hpp"
#include "helix_arm/calibration/calibration.hpp"
#include "helix_arm/calibration/contraction_fit.hpp"
#include "helix_arm/calibration/series_fit.hpp"
#include "helix_arm/calibration/suspects.hpp"
#include "helix_arm/io/provenance.hpp"
#include "helix_arm/io/scene.hpp"
#include "response/inertia_fit.hpp"
#include "response/mode_fit.hpp"
#include "response/response_fit.hpp"

namespace helix_arm::procedures {

/// Request of a calibration.
struct CalibrationRequest {
  /// Parameters to fit: words of estimation::fitWords(); default: stiffness. Without free lengths,
  /// contraction means length_scale.
  std::vector<std::string> fit = {};
  std::string contraction = {};  ///< name of one of the scene's curves; empty if it has only one
  /// Default: kSpline if captures of the arm are fitted as well, else kQuintic. A spline is fitted
  /// together with the arm; the others to the free lengths alone, before.
  std::optional<estimation::CurveKind> curve = {};
  estimation::Branch branch = estimation::Branch::kBoth;
  // Expected standard deviations; 0: those of the scene, for curvatures the default.
  double curvature_noise = 0;                                    ///< [rad]
  double corner_noise = 0;                                       ///< [px]
  double position_noise = 0;                                     ///< of tag poses [m]
  double rotation_noise = 0;                                     ///< of tag poses [rad]
  double rest_offset = estimation::SeriesOptions{}.rest_offset;  ///< [m]
  /// As of CalibrationOptions. A curve that is fitted together with the arm has errors in any case:
  /// whether it is taken depends on them.
  bool errors = true;
  /// Calibrates with the captures as this suspect corrects them, counted from 1; 0: as given.
  int apply_suspect = 0;
  /// Accepts a fit whose captures a suspect explains by 0.9, that predicts worse than before, or
  /// that stays beyond five times the noise of its readings.
  bool force = false;
};

/// Another arm with the same stiffness as the calibrated one.
struct CompanionArm {
  io::Scene scene;
  CalibrationData data;  ///< captures only
};

/// A contraction curve fitted to free lengths and captures together, against the free lengths
/// alone.
struct CurveInArm {
  bool taken = false;  ///< otherwise, the result has the curve of the free lengths
  std::string reason;  ///< why it was not taken; empty if it was
  // Its largest deviation, in standard errors of the free lengths.
  double deviation = 0;        ///< [m]
  double standard_errors = 0;  ///< of the free lengths
  double pressure = 0;         ///< where it is [Pa]
  /// Probability of a deviation at least as large of all of the curve, if captures and free lengths
  /// are of one curve: see CurveTest.
  double probability = 1;
};

/// The response of actuators, fitted to readings in the order taken.
struct FittedResponse {
  std::vector<std::string> contractions;  ///< names of the curves that got it
  estimation::ResponseFit fit;
  /// As written: the fit's; what the data do not determine as the first of the curves had it.
  model::Response response;
  /// The numbers that were found: rise_time_constant and fall_time_constant [s], play_1 .. [Pa] and
  /// play_weight_1 ..
  std::vector<estimation::Parameter> parameters;
};

/// The slowest vibration, fitted to a series of the tip.
struct FittedMode {
  estimation::ModeFit fit;
  std::vector<std::string> trials;  ///< names of the trials
  /// mode_hz [Hz] and mode_damping, if they were found.
  std::vector<estimation::Parameter> parameters;
};

/// Masses and damping, fitted to the vibrations of `CalibrationOutcome::mode`.
struct FittedInertia {
  estimation::InertiaFit fit;
  /// mass_kg, of the whole arm, and damping_bend_s, if they were fitted.
  std::vector<estimation::Parameter> parameters;
};

/// Result of a calibration.
struct CalibrationOutcome {
  bool success = false;
  std::string message;  ///< resultText(), or cause and remedy
  std::vector<std::pair<std::string, estimation::ContractionFit>> contractions;
  std::optional<CurveInArm> curve_in_arm;  ///< if one was fitted
  /// The free lengths, at the effective pressures, to which curves were fitted.
  std::vector<estimation::LengthSample> lengths;
  std::optional<FittedResponse> response;  ///< if one was fitted
  std::optional<FittedMode> mode;          ///< if one was asked for, or mass or damping
  std::optional<FittedInertia> inertia;    ///< if mass or damping was asked for
  /// The arm fitted to a series of its tip, in place of `calibration`.
  std::optional<estimation::SeriesFit> series;
  /// The arms as they were fitted, that of the scene first; empty if only curves were fitted.
  std::vector<estimation::ArmCaptures> arms;
  std::optional<estimation::Calibration> calibration;
  /// K_kappa by the paper's definition, for comparison, if K_kappa and no length scale was fitted;
  /// other parameters as fitted. Tips are those of the shapes fitted to each sound capture's tags;
  /// for curvatures see fitLeastTipError().
  std::optional<estimation::LeastTipError> least_tip_error;
  /// Tip error of the scene's own captures, before and after, where they show tags; else empty [m].
  std::optional<double> tip_error_before, tip_error_after;
  /// Suspects of captures that the fit leaves beyond their noise, best first; empty for series.
  std::vector<estimation::Suspect> suspects;
  std::vector<std::string> warnings;
  std::string scene_text;  ///< of the calibrated scene; empty without success
};

/// Fits the requested parameters and makes the calibrated scene. Writes no file.
///
/// @param path, overrides  file and overrides of the calibrated scene.
/// @throws std::invalid_argument on a word or a number that breaks its rule, DocumentError if the
/// scene has faults. Problems of the data are reported in the outcome.
CalibrationOutcome runCalibration(const std::string& path,
                                  const std::vector<io::Override>& overrides,
                                  const CalibrationRequest& request, const CalibrationData& data,
                                  const std::vector<CompanionArm>& companions = {});

/// The current time in the format of a provenance: UTC, ISO 8601.
std::string utcNow();

/// Provenance, with the current time, of a scene that is made from another one and from data; the
/// results of the fit are left.
io::Provenance provenanceOf(const std::string& path, const std::vector<io::Override>& overrides,
                            const std::string& sha256,
                            const std::vector<io::Provenance::Data>& data);

/// Distance of the model's tip from that of the shape fitted to each capture's tags by itself [m],
/// as in model_error. NaN of captures whose tags determine no shape, or for which the model has
/// none.
std::vector<double> tipErrors(const io::Scene& scene,
                              const std::vector<estimation::Capture>& captures);
/// Their median; nothing if none is a number, as for curvatures.
std::optional<double> medianTipError(const io::Scene& scene,
                                     const std::vector<estimation::Capture>& captures);

// Texts of an outcome.

/// All fitted numbers: those of the calibration, then those of response, mode, mass and damping.
std::vector<estimation::Parameter> parametersOf(const CalibrationOutcome& outcome);

/// Whether a parameter has a standard error and a verdict: not without CalibrationRequest::errors.
bool isJudged(const estimation::Parameter& parameter);

/// Parameters that the data of a calibration determined; without errors, what was fitted.
struct Determined {
  std::vector<estimation::Parameter> parameters;  ///< without those of tags
  std::vector<int> tags;  ///< ids of tags with a parameter that was determined, ascending
  int omitted = 0;        ///< number of parameters that were not determined, those of tags included
};
Determined determinedOf(const CalibrationOutcome& outcome);  ///< what this one determined

/// Value, standard error with two digits, and unit: "K_gamma = 61.7 +- 9.2"; without an error
/// "K_gamma = 61.7231". Pressures in kPa.
std::string textOf(const estimation::Parameter& parameter);

/// Name and relative error: "K_gamma^0.97 K_kappa^0.25 +- 1.2 %", or of 100 % and more
/// "+- a factor of 15".
std::string textOf(const estimation::Combination& combination);

/// Texts in place of the numbers of a placement: "pose of the base" if it has some, "places of 3
/// tags" if these have some.
std::vector<std::string> placementTexts(bool base, std::size_t tags);

/// Tip error before and after [mm]: "tip error 14.3 mm before, 1.0 mm after"; empty if unknown.
std::string tipErrorText(const CalibrationOutcome& outcome);

/// The usual mistakes of tags and pictures that would explain why single shapes fit captures of
/// tags worse than their noise, whatever the pressures: estimation::suspectsOf() of at most 20 of
/// them.
///
/// @param captures  of tag poses or corners; without the tags' scene or any capture, none.
std::vector<estimation::Suspect> tagSuspectsOf(const io::Scene& scene,
                                               const std::vector<estimation::Capture>& captures);

/// One text per suspect: number, cause, place, share and remedy.
std::vector<std::string> textsOf(const std::vector<estimation::Suspect>& suspects);

/// Result of a calibration that succeeded, in one line: its tip error, then what was determined, or
/// without errors what was fitted.
std::string resultText(const std::string& scene, const CalibrationOutcome& outcome);

}  // namespace helix_arm::procedures
