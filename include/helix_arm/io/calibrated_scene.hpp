#pragma once

#include <Eigen/Core>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "helix_arm/estimation/calibration_parameters.hpp"
#include "helix_arm/estimation/contraction_fit.hpp"
#include "helix_arm/io/scene.hpp"

namespace helix_arm::io {

/// What a calibration puts in place of what a scene says; what is absent stays.
struct SceneCalibration {
  std::optional<model::Stiffness> stiffness;  ///< of every actuator
  std::optional<double> K_eps;                ///< of every section [N]
  /// (actuators) factors on the lengths that it has now, or that its new curves give.
  std::optional<Eigen::VectorXd> length_scale;
  std::optional<lie::SE3> X_CB;               ///< base seen from the camera: moves the camera
  std::optional<lie::SE3> X_BF;               ///< frame of tag poses seen from the base
  std::optional<estimation::TagLayout> tags;  ///< placements of the same tags; its size is not read
  double bleed = 0;                           ///< tags look so much smaller at each edge [m]
  /// Curves that replace those of the same names, fitted, and the length scales that these had.
  std::vector<std::pair<std::string, estimation::ContractionFit>> contractions;
  Provenance provenance;
};

/// The changes of a scene that follow from a calibration that succeeded. Contractions and
/// provenance are left empty.
///
/// @param fitted  what was asked for; only these parameters are changed.
/// @param corners  whether the captures were of tag corners. The base then moves the camera,
/// otherwise the frame of tag poses. With corners the scene has a camera.
SceneCalibration changesOf(const Scene& scene, const estimation::Calibration& calibration,
                           const std::set<estimation::FitParameter>& fitted, bool corners);

/// The text of a scene file with a calibration in it: loading it gives the calibrated scene, whose
/// X_CB and placements agree to 1e-12. The comments of the file are not kept.
/// @param sha256  of the file that the calibration is of; empty: of whatever it holds now.
/// @throws DocumentError where the file cannot be read, is not the one that was calibrated or
/// breaks its rules, before or after: also where an actuator's limits reach beyond a new curve.
/// @throws std::invalid_argument on what the scene has no place for: a camera pose without a
/// camera, tags that are not the scene's, another number of actuators, a contraction that it does
/// not have.
std::string calibratedSceneText(const std::string& path, const std::vector<Override>& overrides,
                                const SceneCalibration& calibration,
                                const std::string& sha256 = {});

}  // namespace helix_arm::io
