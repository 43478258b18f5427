#pragma once

#include <optional>
#include <string>
#include <vector>

#include <actionlib/client/simple_action_client.h>
#include <ros/node_handle.h>
#include <ros/steady_timer.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/FollowTipPathAction.h"
#include "helix_arm/FollowTipPathFeedback.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/procedures/tip_record.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/run_node.hpp"

namespace helix_arm::ros_bridge {

/// Records a goal of follow_tip_path: a row for each picture that the loop used, with wanted,
/// model, predicted and measured tip, pressures and state at the time of the picture.
///
/// Subscribes to model, pressure_command and pressure_measured; the client of the action hands on
/// its feedback: roscpp reads an empty message out of bounds where a node subscribes to a topic
/// twice. For the thread of the node's callback queue.
class RunRecorder {
 public:
  /// Where a record goes; empty: nowhere.
  struct Files {
    std::string table;   ///< .csv
    std::string figure;  ///< .png
    bool any() const { return !table.empty() || !figure.empty(); }
  };

  /// @param path    file of the path, named in the record.
  /// @param end     time of the path's last point [s].
  RunRecorder(ros::NodeHandle& node, Files files, std::string path, double end);

  /// Adds a row, unless a number in it is not finite.
  void add(const FollowTipPathFeedback& feedback);
  /// Whether all rows have got what other topics say of their times.
  bool isComplete() const { return record_.isComplete(); }
  /// Writes the files. @param outcome  how the goal ended, in a line.
  /// @return why that failed; empty if it did not.
  std::string write(const std::string& outcome);

 private:
  void onModel(const ArmShapeConstPtr& model);
  void onCommand(const PressureArrayConstPtr& command);
  void onMeasured(const PressureArrayConstPtr& measured);
  void add(procedures::TimeSeries& series, const PressureArray& message);
  std::string tableOf(const std::vector<procedures::TipRow>& rows,
                      const std::string& outcome) const;
  std::string reportOf(const std::vector<procedures::TipRow>& rows) const;

  const Files files_;
  const std::string path_;
  const double end_;
  std::string frame_;               ///< of the tips, by the first feedback
  std::vector<std::string> names_;  ///< of the actuators, by the first pressures
  procedures::TipRecord record_;
  FaultCount foreign_;
  ros::Subscriber model_subscriber_, command_subscriber_, measured_subscriber_;
};

/// Private parameters of follow_path.
struct FollowPathOptions {
  std::string path;             ///< ~path: CSV file, or name of a shipped path; required
  std::string action;           ///< ~action: name of the action; "visual_servo/follow_tip_path"
  std::string frame;            ///< ~frame: in which the path is seen; "", the arm's base
  double path_tolerance = 0.0;  ///< ~path_tolerance_mm: 0 (any) to 1000 [m]
  double goal_tolerance = 0.0;  ///< ~goal_tolerance_mm: 0 (2 mm) to 1000 [m]
  bool require_vision = false;  ///< ~require_vision: abort where the arm is no longer seen
  double hold = 0.0;            ///< ~hold_s: 0 (the loop's own) to 86400 [s]
  double patience = 30.0;       ///< ~patience_s: longest wait for the action, 0 to 3600 [s]
  /// ~record (.csv), ~figure (.png): paths of files to write at the end; "", none.
  RunRecorder::Files files;

  /// @throws ParameterError with every fault.
  static FollowPathOptions load();
};

/// Sends a path file as a goal to visual_servo, and ends with it: a client of ~follow_tip_path.
///
/// Logs the error of the tip once a second, and the result. Where the node is to end, it cancels
/// the goal first. With ~record or ~figure it leaves what a RunRecorder writes, however the goal
/// ends; a file that is there is replaced only if this package wrote it.
///
/// Parameters: FollowPathOptions.
///
/// Ends with 0 if the path was followed, or when asked to; 1 if it was refused or given up, there
/// is no such action, the record cannot be written, or the ROS master is lost; 2 on a bad parameter
/// or path file.
class FollowPathNode {
 public:
  /// @throws io::DocumentError, ParameterError or std::invalid_argument with every fault found.
  FollowPathNode();

  /// Writes the record.
  int finish();
  /// A goal is under way.
  bool isBusy() const { return sent_ && !done_; }

 private:
  using Client = actionlib::SimpleActionClient<FollowTipPathAction>;

  void onTick(const ros::SteadyTimerEvent& event);
  void send();
  void onFeedback(const FollowTipPathFeedback& feedback);
  void onDone(const actionlib::SimpleClientGoalState& state, const FollowTipPathResult* result);
  void endWith(int verdict, const std::string& outcome);
  void endOnceRecorded();

  const FollowPathOptions options_;
  const FollowTipPathGoal goal_;
  ros::NodeHandle node_;
  bool sent_ = false, done_ = false, cancelled_ = false;
  int verdict_ = kDone;
  std::string outcome_ = "it was not ended";  ///< of the goal, for the record
  ros::SteadyTime done_since_;
  std::optional<RunRecorder> recorder_;
  const ros::SteadyTime start_ = ros::SteadyTime::now();
  ros::SteadyTime last_word_;
  FaultGuard guard_{"an answer of follow_tip_path"};
  Client client_;
  ros::SteadyTimer timer_;
};

inline bool mayEnd(const FollowPathNode& node) { return !node.isBusy(); }

}  // namespace helix_arm::ros_bridge
