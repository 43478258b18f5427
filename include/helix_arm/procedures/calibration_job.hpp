#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "helix_arm/estimation/calibration.hpp"
#include "helix_arm/estimation/contraction_fit.hpp"
#include "helix_arm/io/provenance.hpp"
#include "helix_arm/io/scene.hpp"

namespace helix_arm::procedures {

/// What a calibration is asked for.
struct CalibrationRequest {
  /// What to fit, by these words; none: stiffness.
  /// - stiffness: K_kappa and K_gamma; or one of K_kappa, K_gamma, K_tau
  /// - K_eps: of an arm under load
  /// - length_scale, length_scale_each: factors on the free lengths, one for all or one an actuator
  /// - contraction: the curve of the free lengths, from data of free lengths; from captures of an
  ///   arm, as length_scale
  /// - placement: base, tags, and bleed where the captures are of corners; or one of these
  std::vector<std::string> fit;
  std::string contraction;  ///< which of the scene's curves; empty where it has one only
  estimation::ContractionFitOptions curve;
  // Expected standard deviations; 0: the scene's, of curvatures the usual one.
  double curvature_noise = 0;  ///< [rad]
  double corner_noise = 0;     ///< [px]
  double position_noise = 0;   ///< of tag poses [m]
  double rotation_noise = 0;   ///< of tag poses [rad]
  std::string date;            ///< ISO 8601, for the provenance
};

/// What was measured.
struct CalibrationData {
  std::vector<estimation::Capture> captures;
  std::vector<estimation::LengthSample> lengths;
  std::vector<io::Provenance::Data> sources;
  std::vector<std::string> warnings;
};

/// An arm that shares its stiffness with the one that is calibrated.
struct CompanionArm {
  io::Scene scene;
  CalibrationData data;  ///< captures alone
};

/// What became of a request.
struct CalibrationOutcome {
  bool success = false;
  std::string message;  ///< what was done, or culprit and remedy
  std::vector<std::pair<std::string, estimation::ContractionFit>> contractions;
  /// The arms as they were fitted, that of the scene first; empty where nothing but curves was.
  std::vector<estimation::ArmCaptures> arms;
  std::optional<estimation::Calibration> calibration;
  /// K_kappa by the paper's definition, for comparison, where K_kappa and no length scale was
  /// fitted; the rest as fitted. Tips are those of shapes that were fitted to each sound capture's
  /// tags; of curvatures see fitLeastTipError().
  std::optional<estimation::LeastTipError> least_tip_error;
  std::vector<std::string> warnings;
  std::string scene_text;  ///< of the calibrated scene; empty without success
};

/// Adds the captures of one file; where numbers are taken they are counted on, and a warning says
/// so.
void addCaptures(std::vector<estimation::Capture> captures, const std::string& file,
                 CalibrationData& data);

/// Reads data sets of all kinds: curvatures, tag poses, tag corners, free lengths.
/// @throws DocumentError with every fault of a file.
CalibrationData loadCalibrationData(const io::Scene& scene, const std::vector<std::string>& paths);

/// Fits what is asked for and makes the calibrated scene. Writes nothing.
///
/// @param path, overrides  of the scene that is calibrated.
/// @throws std::invalid_argument on a word or a number that breaks its rule, DocumentError where
/// the scene has faults; what data can cause is in the outcome.
CalibrationOutcome runCalibration(const std::string& path,
                                  const std::vector<io::Override>& overrides,
                                  const CalibrationRequest& request, const CalibrationData& data,
                                  const std::vector<CompanionArm>& companions = {});

/// The time now as a provenance has it: UTC, ISO 8601.
std::string utcNow();

}  // namespace helix_arm::procedures
