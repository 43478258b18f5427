#pragma once

#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "helix_arm/calibration/calibration.hpp"
#include "helix_arm/clearance/keep_out.hpp"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/dynamics/motion_config.hpp"
#include "helix_arm/follow/visual_servo_config.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/provenance.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/localization/camera.hpp"
#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/response.hpp"
#include "helix_arm/regulator/config.hpp"
#include "helix_arm/simulation/config.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/vision/config.hpp"

namespace helix_arm::simulation {
struct CameraSetup;
}

namespace helix_arm::io {

/// The camera that looks at the arm.
struct CameraConfig {
  estimation::Camera model;                    ///< its intrinsics
  lie::SE3 X_WC;                               ///< optical frame C (z forward) seen from the world
  std::optional<vision::WebcamConfig> webcam;  ///< if it is connected to this machine
};

/// Deviations of the simulated rig from its scene.
struct SimulationConfig {
  simulation::ArmDeviation arm;
  simulation::MountDeviation mounts;
  simulation::SimulatedCameraConfig camera;
  simulation::SimulatedBodiesConfig bodies;
};

/// The rules of the pressure path.
struct SafetyConfig {
  double commander_timeout = 0.5;  ///< silence after which another commander may take over [s]
  control::SafetyRules rules;
  std::vector<control::ChannelRules> channels;  ///< (actuators); empty for an arm with tendons
};

/// A motion-capture system that sees bodies on the arm, or one at its tip. What a calibration has
/// not found yet is absent.
struct MotionCapture {
  std::optional<lie::SE3> X_BF;         ///< frame F of the poses, seen from the arm's base B
  std::optional<Eigen::Matrix3d> R_TM;  ///< rotation of the body M seen from the tip's frame T
  std::optional<Eigen::Vector3d> p_TM;  ///< its position likewise [m]
  /// Direction of a beam from the tip, whose dot in the x-y plane of F is what is seen: x of T
  /// turned about its y and then its z [rad].
  std::optional<Eigen::Vector2d> beam;
};

/// The content of one scene file: an arm and its rig. What the file omits is absent here.
struct Scene {
  Scene(std::string scene_name, model::Arm in_space, statics::ArmModel of_arm)
      : name(std::move(scene_name)), arm(std::move(in_space)), model(std::move(of_arm)) {}

  std::string name;
  /// Names of its curves, with the responses before them.
  std::map<std::string, model::Response> contractions;
  lie::SE3 X_WB;   ///< arm base B seen from the world W
  model::Arm arm;  ///< the arm in space; of a planar scene, its embedding
  /// The arm in its plane, if the scene says `geometry: planar`.
  std::optional<model::PlanarArm> planar;
  /// The same arm with its load, computed by the tier that the scene asks for or needs.
  statics::ArmModel model;
  dynamics::MotionConfig dynamics;             ///< what its motion takes besides the model
  std::vector<SectionLook> looks;              ///< (sections)
  std::optional<clearance::KeepOut> keep_out;  ///< where the arm may not be
  std::optional<regulator::Config> regulator;
  std::optional<estimation::TagLayout> tags;  ///< or its motion-capture bodies
  estimation::TagPrior tag_prior;             ///< uncertainty of their placements
  /// Frame F of tag poses in data sets, seen from the base; of series of the tip unless
  /// motion_capture has another; of bodies that of motion_capture.
  lie::SE3 X_BF;
  MotionCapture motion_capture;
  std::optional<CameraConfig> camera;
  /// How pictures are searched and fitted, including the family of the tags. Values that the file
  /// omits have their defaults.
  vision::LocalizerConfig vision;
  SimulationConfig simulation;
  SafetyConfig safety;
  /// The loop that is closed over vision, with lag and noise of the scene's regulator. What it
  /// knows at the start is not of its section: procedures::loopConfigOf() adds it.
  helix_arm::follow::VisualServoConfig follow{};
  std::optional<Provenance> calibration;  ///< where it was calibrated
  /// SHA-256 of the bytes read from its file, without overrides; empty if it is not from a file.
  std::string sha256;

  bool hasBodies() const { return tags && tags->hasBodies(); }
  /// Whether something measures its shape: a camera sees tags, or a motion-capture system bodies.
  bool isSeen() const { return tags && (camera || hasBodies()); }
  /// The arm's base seen from the camera, or from the frame of the bodies' poses. Only with one.
  lie::SE3 X_CB() const { return hasBodies() ? X_BF.inverse() : camera->X_WC.inverse() * X_WB; }
  /// The view of the arm. Only if it is seen.
  estimation::ArmView view() const {
    return {camera ? camera->model : estimation::Camera(), X_CB(), *tags, arm.sectionCount()};
  }
  /// Configuration of what sees the simulated arm: camera and tags, or bodies, at their true poses,
  /// each section drawn as thick as its separators. Nothing if it is not seen.
  std::optional<simulation::CameraSetup> cameraSetup() const;
};

/// Reads, checks and resolves a scene file.
/// @throws DocumentError with all faults: `file:line key value rule`.
Scene loadScene(const std::string& path, const std::vector<Override>& overrides = {});

/// The scene that a text describes, for example from calibratedSceneText().
/// @param name  file name used in faults. @throws as loadScene() does.
Scene sceneOfText(const std::string& text, const std::string& name);

/// @throws std::invalid_argument naming the difference if the scenes are not of the same rig: other
/// sections, other actuators, or another geometry.
void requireSameRig(const Scene& at_hand, const Scene& next);

/// The text of a scene file with the overrides applied: loading it gives the same scene without
/// them. The text is unchanged if there are none; otherwise it loses its comments.
/// @throws DocumentError if the file cannot be read, is not YAML or an override does not apply.
std::string sceneText(const std::string& path, const std::vector<Override>& overrides = {});

}  // namespace helix_arm::io
