#pragma once

/// Names that nodes share: topics (relative, so that a namespace applies), frames, diagnostics.
namespace helix_arm::ros_bridge::names {

// Topics; docs/interfaces.md quotes these comments, unless a definition in msg says what one means.
/// pressures to go to, gauge; actuators left out keep their command
inline constexpr char kPressureTarget[] = "pressure_target";
inline constexpr char kShapeTarget[] = "shape_target";
inline constexpr char kTipTarget[] = "tip_target";
/// tip to go to; the position alone where the orientation is all 0
inline constexpr char kTipTargetPose[] = "tip_target_pose";
inline constexpr char kPressureCommand[] = "pressure_command";    ///< command in force, gauge
inline constexpr char kPressureMeasured[] = "pressure_measured";  ///< readings, gauge
inline constexpr char kSafetyState[] = "safety_state";
/// shape at the measured pressures, under the scene's load
inline constexpr char kModel[] = "model";
inline constexpr char kModelTip[] = "tip_model";  ///< tip of the model
/// pressure and command (effort); SECTION_bend_y, _bend_z and _twist of the model
inline constexpr char kJointStates[] = "joint_states";
inline constexpr char kTargetStatus[] = "target_status";
inline constexpr char kMarkers[] = "markers";                   ///< drawing of the model
inline constexpr char kImage[] = "image";                       ///< picture, not rectified
inline constexpr char kCompressedImage[] = "image/compressed";  ///< picture as JPEG, not rectified
inline constexpr char kCameraInfo[] = "camera_info";            ///< intrinsics
inline constexpr char kMeasured[] = "measured";  ///< shape and covariance, stamped like the picture
inline constexpr char kTip[] = "tip";            ///< measured tip
inline constexpr char kTruth[] = "truth";        ///< true shape of the simulated arm
/// force on the simulated arm's tip, seen from arm_base, at most 100 N
inline constexpr char kTipForce[] = "tip_force";
inline constexpr char kTagDetections[] = "tag_detections";
inline constexpr char kBodyPoses[] = "body_poses";
inline constexpr char kModelError[] = "model_error";
inline constexpr char kVisionStatus[] = "vision_status";
/// picture with tags, model (dashed) and measured curve (solid)
inline constexpr char kOverlay[] = "overlay";
inline constexpr char kMeasuredMarkers[] = "measured_markers";  ///< drawing of the measured arm
/// shape of the corrected model at the effective pressures, with covariance
inline constexpr char kEstimate[] = "estimate";
inline constexpr char kErrorBudget[] = "error_budget";
inline constexpr char kExternalLoad[] = "external_load";
inline constexpr char kVisualServoStatus[] = "loop_status";
inline constexpr char kLoopMarkers[] = "loop_markers";  ///< drawing of the loop
inline constexpr char kTipHandle[] = "tip_handle";      ///< interactive marker at the tip
inline constexpr char kClock[] = "/clock";              ///< of simulated time
inline constexpr char kTf[] = "/tf";                    ///< frames; one for all robots
inline constexpr char kStaticTf[] = "/tf_static";       ///< fixed frames, latched
inline constexpr char kDiagnostics[] = "/diagnostics";  ///< states of all robots (REP-107)

// Services and actions, below the names of their nodes.
inline constexpr char kReload[] = "reload";
inline constexpr char kEnable[] = "enable";  ///< enables the arm, or says why not
inline constexpr char kForward[] = "forward";
inline constexpr char kInverse[] = "inverse";
inline constexpr char kPayload[] = "payload";
inline constexpr char kRest[] = "rest";  ///< ramps down and rests, without a fault
inline constexpr char kVent[] = "vent";  ///< vents all channels
/// true: vents and latches; false: releases
inline constexpr char kEmergencyStop[] = "emergency_stop";
inline constexpr char kRecordSample[] = "record_sample";
inline constexpr char kSave[] = "save";
inline constexpr char kRunCalibration[] = "run_calibration";
inline constexpr char kRunExperiment[] = "run_experiment";
/// false: the correction fades out within a second
inline constexpr char kCloseLoop[] = "close_loop";
/// clears what was learnt from pictures; ends diverging and doubtful
inline constexpr char kReset[] = "reset";
inline constexpr char kFollowTipPath[] = "follow_tip_path";
inline constexpr char kPlanTipPath[] = "plan_tip_path";

// Nodes.
inline constexpr char kPressureCommandNode[] = "pressure_command";
inline constexpr char kSimulatedRigNode[] = "simulated_rig";
inline constexpr char kVisionNode[] = "vision";
inline constexpr char kCalibrationNode[] = "calibration";
inline constexpr char kExperimentNode[] = "experiment";
inline constexpr char kVisualServoNode[] = "visual_servo";

// Name of the commander when the interactive marker is dragged in any rviz.
inline constexpr char kInteractiveMarker[] = "interactive_marker";

// Frames; those of the arm have the prefix from the node's parameters.
inline constexpr char kWorldFrame[] = "world";
inline constexpr char kBaseFrame[] = "arm_base";
// Frames of one shape, followed by 0 .. n from the base to the tip, and by kTipFrame.
inline constexpr char kModelFrames[] = "model_";
inline constexpr char kMeasuredFrames[] = "measured_";
inline constexpr char kTipFrame[] = "tip";
inline constexpr char kCameraFrame[] = "camera_optical";
inline constexpr char kPoseFrame[] = "mocap";  ///< of simulated bodies

// Diagnostics: `<node>: <status>`, and the keys that others read.
inline constexpr char kLoopStatus[] = "loop";
inline constexpr char kModelStatus[] = "model";
inline constexpr char kSafetyStatus[] = "safety";
inline constexpr char kChannelStatus[] = "channel ";             ///< followed by the actuator
inline constexpr char kTargetTimeoutKey[] = "target_timeout_s";  ///< of the safety core
inline constexpr char kLowerLimitKey[] = "lower_limit_kpa";      ///< of a channel
inline constexpr char kUpperLimitKey[] = "upper_limit_kpa";
inline constexpr char kSceneKey[] = "scene_sha256";  ///< of the first status
inline constexpr char kLastFaultKey[] = "last_fault";
inline constexpr char kAcceptedKey[] = "accepted";
inline constexpr char kWithoutTagsKey[] = "without_tags";
inline constexpr char kRefusedPrefix[] = "refused_";  ///< followed by the fault

}  // namespace helix_arm::ros_bridge::names
