#pragma once

/// Names that nodes share: topics (relative, so that a namespace applies), frames, diagnostics.
namespace helix_arm::ros_bridge::names {

// Topics.
inline constexpr char kPressureTarget[] = "pressure_target";
inline constexpr char kShapeTarget[] = "shape_target";
inline constexpr char kTipTarget[] = "tip_target";
inline constexpr char kTipTargetPose[] = "tip_target_pose";
inline constexpr char kPressureCommand[] = "pressure_command";
inline constexpr char kPressureMeasured[] = "pressure_measured";
inline constexpr char kSafetyState[] = "safety_state";
inline constexpr char kModel[] = "model";
inline constexpr char kModelTip[] = "tip_model";
inline constexpr char kJointStates[] = "joint_states";
inline constexpr char kTargetStatus[] = "target_status";
inline constexpr char kMarkers[] = "markers";
inline constexpr char kImage[] = "image";
inline constexpr char kCompressedImage[] = "image/compressed";
inline constexpr char kCameraInfo[] = "camera_info";
inline constexpr char kMeasured[] = "measured";
inline constexpr char kTip[] = "tip";             ///< measured
inline constexpr char kTruth[] = "truth";         ///< of a simulated arm
inline constexpr char kTipForce[] = "tip_force";  ///< of a simulated arm, below its node's name
inline constexpr char kTagDetections[] = "tag_detections";
inline constexpr char kBodyPoses[] = "body_poses";
inline constexpr char kModelError[] = "model_error";
inline constexpr char kVisionStatus[] = "vision_status";
inline constexpr char kOverlay[] = "overlay";
inline constexpr char kMeasuredMarkers[] = "measured_markers";
inline constexpr char kEstimate[] = "estimate";
inline constexpr char kErrorBudget[] = "error_budget";
inline constexpr char kExternalLoad[] = "external_load";
inline constexpr char kVisualServoStatus[] = "loop_status";
inline constexpr char kLoopMarkers[] = "loop_markers";
/// Namespace of the interactive marker's topics.
inline constexpr char kTipHandle[] = "tip_handle";
inline constexpr char kClock[] = "/clock";              ///< of simulated time
inline constexpr char kTf[] = "/tf";                    ///< one for all robots
inline constexpr char kStaticTf[] = "/tf_static";       ///< latched
inline constexpr char kDiagnostics[] = "/diagnostics";  ///< one for all robots (REP-107)

// Services and actions, below the names of their nodes.
inline constexpr char kReload[] = "reload";
inline constexpr char kEnable[] = "enable";
inline constexpr char kForward[] = "forward";
inline constexpr char kInverse[] = "inverse";
inline constexpr char kPayload[] = "payload";
inline constexpr char kRest[] = "rest";
inline constexpr char kVent[] = "vent";
inline constexpr char kEmergencyStop[] = "emergency_stop";
inline constexpr char kRecordSample[] = "record_sample";
inline constexpr char kSave[] = "save";
inline constexpr char kRunCalibration[] = "run_calibration";
inline constexpr char kRunExperiment[] = "run_experiment";
inline constexpr char kCloseLoop[] = "close_loop";
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
