#pragma once

#include <Eigen/Core>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "helix_arm/calibration/calibration_parameters.hpp"
#include "helix_arm/calibration/contraction_fit.hpp"
#include "helix_arm/follow/visual_servo_config.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/localization/camera.hpp"
#include "helix_arm/model/response.hpp"
#include "helix_arm/tracking/mode_estimator.hpp"

namespace helix_arm::io {

/// Changes of a scene by a calibration; absent members leave the scene as it is.
struct SceneCalibration {
  std::optional<model::Stiffness> stiffness;  ///< of every actuator
  /// How K_kappa of every section depends on pressure; absent: as before. Needs stiffness.
  std::optional<model::BendingTable> bending;
  std::optional<double> K_eps;  ///< of every section [N]
  /// Factors on it as a function of the actuators' inputs; empty: it is constant.
  model::StiffnessTable K_eps_table;
  /// (actuators) factors on the current lengths, or on those of the new curves.
  std::optional<Eigen::VectorXd> length_scale;
  std::optional<Eigen::VectorXd> ring_radius;  ///< (sections) factors on it
  std::optional<Eigen::VectorXd> ring_phase;   ///< (actuators of rings) turns about the arm [rad]
  std::optional<lie::SE3> X_CB;                ///< base seen from the camera: moves the camera
  std::optional<lie::SE3> X_BF;                ///< frame of tag poses seen from the base
  MotionCapture motion_capture;                ///< what was found of it
  /// Placements of the same tags; the tag size is ignored.
  std::optional<estimation::TagLayout> tags;
  /// Values of other fitted parameters: stroke scales (actuators), factors on those of the scene or
  /// of the new curves; the border shift (1), by which tags look smaller at each edge [m].
  std::map<estimation::FitParameter, Eigen::VectorXd> numbers;
  /// Fitted curves that replace those of the same names, with the length scales that these had.
  std::vector<std::pair<std::string, estimation::ContractionFit>> contractions;
  /// Fitted responses of the curves of these names; without lag or play, the key is removed.
  std::vector<std::pair<std::string, model::Response>> responses;
  /// The arm's slowest vibration: follow.mode_hz and follow.mode_damping.
  std::optional<estimation::Mode> mode;
  std::optional<double> mass_factor;             ///< on load.mass_kg, which the scene then has
  std::optional<dynamics::StrainTimes> damping;  ///< dynamics.damping_s
  Provenance provenance;
};

/// Adds the changes of a scene that follow from a successful calibration.
///
/// @param fitted  the requested parameters; only these are changed.
/// @param corners  whether the captures were of tag corners. If true, the base moves the camera,
/// and the scene must have one; otherwise it moves the frame of tag poses.
void addChanges(const Scene& scene, const estimation::Calibration& calibration,
                const std::set<estimation::FitParameter>& fitted, bool corners,
                SceneCalibration& changes);

/// The text of a scene file with a calibration applied: loading it gives the calibrated scene,
/// whose X_CB and placements agree to 1e-12. The comments of the file are not kept.
/// @param sha256  hash of the calibrated file; empty to accept its current content.
/// @throws DocumentError if the file cannot be read, is not the calibrated one, or breaks its rules
/// before or after the change, including actuator limits beyond a new curve.
/// @throws std::invalid_argument on an unknown contraction, K_eps of a scene without a load, or a
/// tag on another section. Otherwise the changes have to be of this scene.
std::string calibratedSceneText(const std::string& path, const std::vector<Override>& overrides,
                                const SceneCalibration& calibration,
                                const std::string& sha256 = {});

/// The overrides, and those that lower the limits of all actuators with a curve to a pressure [Pa].
/// @throws DocumentError if the file cannot be read.
std::vector<Override> withLimit(const std::string& path, std::vector<Override> overrides,
                                const std::string& curve, double pressure);

/// @throws std::invalid_argument if a section of a sound scene file lists its actuators, so that
/// its radius and phase cannot be changed; DocumentError if the file cannot be read.
void requireRings(const std::string& path, const std::vector<Override>& overrides);
/// Whether none does.
/// @throws DocumentError likewise.
bool hasRingsOnly(const std::string& path, const std::vector<Override>& overrides);

/// New values of a scene's camera; absent members leave the scene as it is.
struct CameraChange {
  std::optional<estimation::Camera> intrinsics;
  std::optional<lie::SE3> X_WC;  ///< optical frame C (z forward) seen from the world
};

/// The text of a scene file with the change applied: loading it gives a scene with these values.
/// The comments of the file are not kept.
/// @throws DocumentError if the file cannot be read or breaks its rules before or after the change.
/// @throws std::invalid_argument on a scene without a camera.
std::string sceneTextWithCamera(const std::string& path, const std::vector<Override>& overrides,
                                const CameraChange& change);

/// The text of a scene file with what of a rig is otherwise. The comments of the file are not kept.
/// @param tags      size and placements of the same tags; absent: as they are.
/// @param channels  (actuators) index of the actuator whose channel of the regulator each of them
/// has; empty: its own.
/// @throws DocumentError if the file cannot be read or breaks its rules before or after the change.
/// @throws std::invalid_argument with the remedy where a scene cannot say it: a regulator without
/// addresses or slots, a tag on another section.
std::string sceneTextWithRig(const std::string& path, const std::vector<Override>& overrides,
                             const std::optional<estimation::TagLayout>& tags,
                             const std::vector<int>& channels);

/// The text of a scene file with follow.contact_limit and follow.on_contact. The comments of the
/// file are not kept.
/// @param title  lines of comment to begin with.
/// @throws DocumentError if the file cannot be read or breaks its rules before or after the change.
std::string sceneTextWithContacts(const std::string& path, const std::vector<Override>& overrides,
                                  double limit, follow::OnContact reaction,
                                  const std::string& title);

/// The text of a calibration file of camera_info_manager and camera_calibration_parsers (YAML):
/// plumb_bob, or rational_polynomial if k4, k5 or k6 is not 0.
/// @param name  of the camera: letters, digits and _.
std::string cameraInfoText(const estimation::Camera& camera, const std::string& name);

/// Position [m] and roll, pitch, yaw [degrees] of a camera as in a scene's section camera: x is the
/// optical axis.
struct CameraPlace {
  Eigen::Vector3d position;
  Eigen::Vector3d rpy_deg;
};
CameraPlace cameraPlaceOf(const lie::SE3& X_WC);

}  // namespace helix_arm::io
