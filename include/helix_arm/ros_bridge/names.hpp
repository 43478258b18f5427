#pragma once

/// Every name that the nodes share: topics (relative, so that a namespace moves them), frames and
/// diagnostics.
namespace helix_arm::ros_bridge::names {

// Topics.
inline constexpr char kPressureTarget[] = "pressure_target";
inline constexpr char kShapeTarget[] = "shape_target";
inline constexpr char kTipTarget[] = "tip_target";
inline constexpr char kPressureCommand[] = "pressure_command";
inline constexpr char kPressureMeasured[] = "pressure_measured";
inline constexpr char kModel[] = "model";
inline constexpr char kTargetStatus[] = "target_status";
inline constexpr char kMarkers[] = "markers";
inline constexpr char kTipHandle[] =
    "tip_handle";  ///< namespace of the interactive marker's topics
inline constexpr char kDiagnostics[] = "/diagnostics";  ///< one for all robots (REP-107)

// Nodes.
inline constexpr char kPressureCommandNode[] = "pressure_command";
inline constexpr char kPressureSeriesNode[] = "pressure_series";
inline constexpr char kMonitorNode[] = "monitor";

// Who commands when the interactive marker is dragged, whichever rviz drags it.
inline constexpr char kInteractiveMarker[] = "interactive_marker";

// Frames; those of the arm carry the prefix of the node's parameters.
inline constexpr char kWorldFrame[] = "world";
inline constexpr char kBaseFrame[] = "arm_base";
inline constexpr char kModelFrame[] = "model_";  ///< followed by 0 .. n, from the base to the tip
inline constexpr char kTipFrame[] = "model_tip";

// Namespaces of the markers.
inline constexpr char kMusclesNs[] = "muscles";
inline constexpr char kBaseCurveNs[] = "base_curve";
inline constexpr char kSeparatorsNs[] = "separators";
inline constexpr char kTipTraceNs[] = "tip_trace";
inline constexpr char kPressuresNs[] = "pressures";

// Diagnostics: `<node>: targets` and `<node>: loop`, and the keys that others read.
inline constexpr char kTargetsStatus[] = "targets";
inline constexpr char kLoopStatus[] = "loop";
inline constexpr char kDroppedKey[] = "dropped";  ///< total; per reason `dropped_<fault>`
inline constexpr char kDroppedPrefix[] = "dropped_";
inline constexpr char kTakenKey[] = "taken";
inline constexpr char kClosestKey[] = "closest";
inline constexpr char kLeaseHolderKey[] = "lease_holder";
inline constexpr char kLastFaultKey[] = "last_fault";
inline constexpr char kRateKey[] = "rate_hz";
inline constexpr char kWantedRateKey[] = "wanted_rate_hz";

}  // namespace helix_arm::ros_bridge::names
