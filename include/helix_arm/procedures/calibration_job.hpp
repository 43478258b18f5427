#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "helix_arm/estimation/calibration.hpp"
#include "helix_arm/estimation/contraction_fit.hpp"
#include "helix_arm/io/provenance.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/calibration_data.hpp"

namespace helix_arm::procedures {

/// What a calibration is asked for.
struct CalibrationRequest {
  /// What to fit: words of estimation::fitWords(); none: stiffness. Without free lengths,
  /// contraction means length_scale.
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
