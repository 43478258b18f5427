#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <actionlib/server/simple_action_server.h>
#include <ros/node_handle.h>

#include "calibrator.hpp"
#include "helix_arm/RunCalibrationAction.h"
#include "helix_arm/TargetStatus.h"
#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/procedures/calibration_run.hpp"
#include "helix_arm/procedures/settle_watch.hpp"
#include "recorder.hpp"
#include "ros_bridge/common/client_watch.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/rest_request.hpp"

namespace helix_arm::ros_bridge {

/// Serves the action ~run_calibration in a thread of its own: forgets what was recorded, steps the
/// arm through a plan of pressures and records it at each, ramps down, asks pressure_command to
/// rest, if the arm follows it and no other goal waits, and calibrates. Where the node that sent
/// the goal is gone, it ramps down at once.
///
/// Subscribes to target_status. Publishes pressure_target, all actuators, gauge [Pa], during a run
/// alone. Its mutex is locked before that of Recorder.
class RunAction {
 public:
  /// @param node, private_node  Of the node.
  /// @param rules  Of each run, except for the captures, which a goal gives.
  /// @param rate   Of the targets during a run [Hz].
  /// @param jobs, recorder, calibrator  These outlive it.
  RunAction(ros::NodeHandle& node, ros::NodeHandle& private_node, const procedures::RunRules& rules,
            double rate, JobSlot& jobs, Recorder& recorder, Calibrator& calibrator);
  ~RunAction();
  RunAction(const RunAction&) = delete;
  RunAction& operator=(const RunAction&) = delete;

 private:
  using Server = actionlib::SimpleActionServer<RunCalibrationAction>;

  /// A run and the arm that it moves.
  struct Motion {
    model::Arm arm;
    procedures::CalibrationRun run;
    bool waited = false;  ///< for pictures, in its last turn
  };
  /// How a run ended.
  struct Ending {
    procedures::RunEnd verdict;
    std::string reason;
    int steps;
  };
  /// One turn of a run.
  struct Turn {
    std::optional<Ending> ending;  ///< the run has ended; nothing was commanded
    RunCalibrationFeedback feedback;
  };

  /// In the spinning thread.
  void onStatus(const TargetStatusConstPtr& status) HELIX_ARM_EXCLUDES(mutex_);

  // Thread of the action.
  void onGoal(const RunCalibrationGoal& goal) HELIX_ARM_EXCLUDES(mutex_);
  /// @throws std::exception with the reason where the run cannot begin.
  void begin(const RunCalibrationGoal& goal) HELIX_ARM_EXCLUDES(mutex_);
  /// Moves the arm until the run has ended; absent where ROS was shut down before.
  std::optional<Ending> play() HELIX_ARM_EXCLUDES(mutex_);
  /// @param captures  Of this step so far; goes on.
  Turn turn(std::vector<procedures::Sample>& captures) HELIX_ARM_EXCLUDES(mutex_);
  /// Brings the arm to rest after a run, if it is still the run's and no other goal waits for it.
  void rest() HELIX_ARM_EXCLUDES(mutex_);
  /// Calibrates where the run was completed, and sets the result.
  void conclude(const RunCalibrationGoal& goal, const Ending& ending);

  const procedures::RunRules rules_;
  const double rate_;  ///< [Hz]
  JobSlot& jobs_;
  Recorder& recorder_;
  Calibrator& calibrator_;

  /// Orders the targets, too: none is published once another commander has the arm.
  basics::Mutex mutex_;
  /// From the begin of a run to its result.
  std::optional<Motion> motion_ HELIX_ARM_GUARDED_BY(mutex_);
  CommandTrace trace_ HELIX_ARM_GUARDED_BY(mutex_);
  FaultCount stale_targets_ HELIX_ARM_GUARDED_BY(mutex_);

  ros::Publisher target_publisher_;
  ros::Subscriber status_subscriber_;
  GoalClient<RunCalibrationActionGoal> client_;  ///< of the present run
  FaultGuard goal_guard_{"a goal of run_calibration"};
  std::unique_ptr<Server> server_;  ///< last: its end waits for the thread of the action
};

}  // namespace helix_arm::ros_bridge
