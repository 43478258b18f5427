#pragma once

#include <string>

#include <ros/node_handle.h>

#include "calibrator.hpp"
#include "helix_arm/Calibrate.h"
#include "helix_arm/ClearSamples.h"
#include "helix_arm/FitContraction.h"
#include "helix_arm/RecordSample.h"
#include "helix_arm/Save.h"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/calibration_run.hpp"
#include "helix_arm/procedures/settle_watch.hpp"
#include "recorder.hpp"
#include "ros_bridge/common/reload_server.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "run_action.hpp"

namespace helix_arm::ros_bridge {

/// Serves ~record_sample, ~clear_samples, ~save, ~calibrate and ~fit_contraction, in the spinning
/// thread. While run_calibration is under way, each is refused.
class CalibrationServices {
 public:
  /// @param node  The private one.
  /// @param jobs, recorder, calibrator  These outlive it.
  CalibrationServices(ros::NodeHandle& node, JobSlot& jobs, Recorder& recorder,
                      Calibrator& calibrator);
  CalibrationServices(const CalibrationServices&) = delete;
  CalibrationServices& operator=(const CalibrationServices&) = delete;

 private:
  bool onCalibrate(Calibrate::Request& request, Calibrate::Response& response);
  bool onFitContraction(FitContraction::Request& request, FitContraction::Response& response);
  bool onRecord(RecordSample::Request& request, RecordSample::Response& response);
  bool onClear(ClearSamples::Request& request, ClearSamples::Response& response);
  bool onSave(Save::Request& request, Save::Response& response);

  JobSlot& jobs_;
  Recorder& recorder_;
  Calibrator& calibrator_;
  ros::ServiceServer calibrate_, fit_contraction_, record_, clear_, save_;
};

/// Private parameters of calibration.
struct CalibrationNodeOptions {
  std::string scene;  ///< ~scene: as pressure_command's; required
  /// ~scene_folder: below which ~reload takes scenes, beside those of the package and ~scene;
  /// `helix_arm` below ROS_HOME by default.
  std::string scene_folder;
  /// ~data_folder, ~out_folder: below which data sets are read (of either), and scenes and samples
  /// are written (of the second); as ~scene_folder by default, and made where they are missing.
  std::string data_folder, out_folder;
  /// ~pressure_tolerance_kpa (0.01 to 100), ~corner_tolerance_px (0.01 to 100), ~window_s (0.05 to
  /// 60), ~max_age_s (0.05 to 60): when the arm stands still, and when measurements are stale.
  procedures::SettleRules settle;
  /// ~ramp_kpa_s (0.1 to 10000): how fast run_calibration changes a pressure; ~patience_s (0.1 to
  /// 3600): its longest wait for a capture.
  procedures::RunRules run;
  double rate = 50.0;  ///< ~rate: of the targets during run_calibration, 5 to 1000 [Hz]

  /// @throws ParameterError with every fault.
  static CalibrationNodeOptions load();
};

/// Records the arm where it stands still, and calibrates the scene with what was recorded or with
/// data sets.
///
/// Subscribes
/// - tag_detections (TagDetections), vision_status (VisionStatus), measured (ArmShape): of vision
/// - pressure_measured, pressure_command (PressureArray); target_status (TargetStatus)
///
/// Publishes
/// - pressure_target (PressureArray): during run_calibration alone; all actuators, gauge [Pa]
///
/// Services
/// - ~calibrate (Calibrate), ~fit_contraction (FitContraction): fit, and write a scene file
/// - ~record_sample (RecordSample), ~clear_samples (ClearSamples), ~save (Save)
/// - ~reload (Reload): another file of the same rig; samples stay
///
/// Action
/// - ~run_calibration (RunCalibration): forgets what was recorded, ramps the pressures through a
///   plan, waits at each until the arm stands still, records it, ramps down, calls
///   pressure_command/rest and calibrates. Preempted, without fresh measurements, where the arm
///   does not settle, and when the node is to end, it ramps down and ends without a calibration;
///   what was recorded stays. When another commander has the arm, it ends and leaves the arm to it.
///
/// Parameters: CalibrationNodeOptions.
///
/// Ages and windows go by the stamps of messages and ROS time, so that simulated time may run fast.
/// Where ROS time stands still the run ends, and ramps down by a steady clock.
///
/// Messages, services and ~reload are handled in the spinning thread, run_calibration in a thread
/// of its own. Locks in their order: ReloadServer, JobSlot or RunAction, Recorder or Calibrator.
///
/// Ends with 0 when asked to, 1 when the ROS master is lost, 2 on a bad scene or parameter.
class CalibrationNode {
 public:
  /// @throws io::DocumentError, ParameterError or std::invalid_argument with every fault found.
  CalibrationNode();
  ~CalibrationNode();

  int finish() const { return kDone; }
  /// run_calibration is under way: the arm is to be ramped down first.
  bool isBusy() const { return jobs_.runs(); }

 private:
  void adopt(io::Scene next);

  const CalibrationNodeOptions options_;
  ros::NodeHandle node_, private_node_{"~"};
  JobSlot jobs_;
  Recorder recorder_;
  Calibrator calibrator_;
  CalibrationServices services_;
  ReloadServer reload_;
  RunAction run_;  ///< last: its thread uses all of the above
};

inline bool mayEnd(const CalibrationNode& node) { return !node.isBusy(); }

}  // namespace helix_arm::ros_bridge
