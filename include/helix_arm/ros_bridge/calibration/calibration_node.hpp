#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <actionlib/server/simple_action_server.h>
#include <ros/node_handle.h>
#include <ros/steady_timer.h>

#include "helix_arm/Calibrate.h"
#include "helix_arm/ClearSamples.h"
#include "helix_arm/FitContraction.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/RecordSample.h"
#include "helix_arm/RunCalibrationAction.h"
#include "helix_arm/Save.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/TargetStatus.h"
#include "helix_arm/VisionStatus.h"
#include "helix_arm/procedures/calibration_job.hpp"
#include "helix_arm/procedures/calibration_run.hpp"
#include "helix_arm/procedures/settle_watch.hpp"
#include "helix_arm/ros_bridge/common/diagnostics.hpp"
#include "helix_arm/ros_bridge/common/file_access.hpp"
#include "helix_arm/ros_bridge/common/guarded_callbacks.hpp"
#include "helix_arm/ros_bridge/common/moving_clock.hpp"
#include "helix_arm/ros_bridge/common/reload_server.hpp"
#include "helix_arm/ros_bridge/common/run_node.hpp"

namespace helix_arm::ros_bridge {

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
/// - tag_detections (TagDetections), vision_status (VisionStatus): of vision
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
///   plan, waits at each until the arm stands still, records it, ramps down and calibrates.
///   Preempted, without fresh measurements, where the arm does not settle, and when the node is to
///   end, it ramps down and ends without a calibration; what was recorded stays. When another
///   commander has the arm, it ends and leaves the arm to it.
///
/// Parameters: CalibrationNodeOptions.
///
/// Ages and windows go by the stamps of messages and ROS time, so that simulated time may run fast.
/// Where ROS time stands still the run ends, and ramps down by a steady clock.
///
/// Ends with 0 when asked to, 1 when the ROS master is lost, 2 on a bad scene or parameter.
class CalibrationNode {
 public:
  /// @throws io::DocumentError, ParameterError or std::invalid_argument with every fault found.
  CalibrationNode();
  ~CalibrationNode();

  int finish() const { return kDone; }
  bool isBusy() const;  ///< run_calibration is under way: the arm is to be ramped down first

 private:
  using Server = actionlib::SimpleActionServer<RunCalibrationAction>;

  /// Keeps others from starting while a service fits.
  struct Fitting {
    explicit Fitting(CalibrationNode& owner) : node(owner) {
      const std::lock_guard<std::mutex> lock(node.mutex_);
      node.requireIdle();
      node.fitting_ = true;
    }
    ~Fitting() {
      const std::lock_guard<std::mutex> lock(node.mutex_);
      node.fitting_ = false;
    }
    CalibrationNode& node;
  };

  // Callbacks of the spinning thread.
  void onDetections(const TagDetectionsConstPtr& detections);
  void onMeasured(const PressureArrayConstPtr& measured);
  void onCommand(const PressureArrayConstPtr& command);
  void onStatus(const TargetStatusConstPtr& status);
  void onVision(const VisionStatusConstPtr& status);
  void onWatch(const ros::SteadyTimerEvent& event);
  bool onCalibrate(Calibrate::Request& request, Calibrate::Response& response);
  bool onFitContraction(FitContraction::Request& request, FitContraction::Response& response);
  bool onRecord(RecordSample::Request& request, RecordSample::Response& response);
  bool onClear(ClearSamples::Request& request, ClearSamples::Response& response);
  bool onSave(Save::Request& request, Save::Response& response);
  void adopt(io::Scene next);

  // Thread of the action.
  void onGoal(const RunCalibrationGoal& goal);
  void begin(const RunCalibrationGoal& goal);
  bool play();
  void conclude(const RunCalibrationGoal& goal);

  // With mutex_ locked.
  /// @throws std::invalid_argument while run_calibration or a fit is under way.
  void requireIdle() const;
  procedures::Settling settling(double now) const;
  procedures::CalibrationData recorded() const;
  std::optional<Eigen::VectorXd> reading(const PressureArray& message, const char* topic);

  /// Where a calibrated scene goes; empty stays empty.
  /// @throws std::invalid_argument where it may not.
  std::string writable(const std::string& out) const;
  procedures::CalibrationData load(const std::vector<std::string>& paths) const;
  /// Fits, and writes the scene when there is a path and nobody has cancelled it meanwhile.
  procedures::CalibrationOutcome calibrate(const procedures::CalibrationRequest& request,
                                           const procedures::CalibrationData& data,
                                           const std::string& out,
                                           const std::function<bool()>& cancelled);

  const CalibrationNodeOptions options_;
  mutable std::mutex mutex_;  ///< of all below, up to the publisher
  MovingClock clock_;
  io::Scene scene_;
  const FileAccess data_access_, out_access_;
  procedures::SettleWatch watch_;
  std::optional<VisionStatus> vision_;  ///< the last one
  FaultCount foreign_pressures_;
  std::vector<procedures::Sample> samples_;
  std::optional<procedures::CalibrationOutcome> last_;  ///< the last one that calibrated the scene
  bool running_ = false;                                ///< an action is under way
  bool fitting_ = false;                                ///< a service fits
  std::optional<procedures::CalibrationRun> run_;       ///< while it moves the arm

  ros::NodeHandle node_;
  ros::Publisher target_publisher_;
  ros::Subscriber detections_subscriber_, measured_subscriber_, command_subscriber_;
  ros::Subscriber status_subscriber_, vision_subscriber_;
  ros::ServiceServer calibrate_, fit_contraction_, record_, clear_, save_;
  std::unique_ptr<ReloadServer> reload_;
  ros::SteadyTimer watch_timer_;
  FaultGuard goal_guard_{"a goal of run_calibration"};
  std::unique_ptr<Server> server_;
};

inline bool mayEnd(const CalibrationNode& node) { return !node.isBusy(); }

}  // namespace helix_arm::ros_bridge
