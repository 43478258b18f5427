#include <algorithm>
#include <chrono>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

#include <actionlib/server/simple_action_server.h>
#include <ros/init.h>
#include <ros/node_handle.h>
#include <ros/this_node.h>

#include "calibrator.hpp"
#include "helix_arm/PressureArray.h"
#include "helix_arm/RunCalibrationAction.h"
#include "helix_arm/RunCalibrationActionGoal.h"
#include "helix_arm/TargetStatus.h"
#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/calibration/calibration_parameters.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/procedures/calibration_run.hpp"
#include "helix_arm/procedures/pressure_plan.hpp"
#include "helix_arm/procedures/settle_watch.hpp"
#include "recorder.hpp"
#include "ros_bridge/common/client_watch.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/end_watch.hpp"
#include "ros_bridge/common/goal_serializers.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/rest_request.hpp"
#include "ros_bridge/names.hpp"

namespace ros::serialization {

template <>
struct Serializer<helix_arm::RunCalibrationActionGoal>
    : helix_arm::ros_bridge::GoalSerializer<helix_arm::RunCalibrationActionGoal> {};

}  // namespace ros::serialization

namespace helix_arm::ros_bridge {
namespace {

constexpr double kFeedbackPeriod = 0.2;  // [s]
constexpr int kUsualCaptures = 3;        // per pressure
constexpr std::chrono::milliseconds kBetweenLooks(5);

/// Serves the action ~run_calibration in a thread of its own: forgets what was recorded, steps the
/// arm through a plan of pressures and records it at each, ramps down, asks pressure_command to
/// rest, if the arm follows it and no other goal waits, and calibrates. Where the node that sent
/// the goal is gone, it ramps down at once.
///
/// Subscribes to target_status. Publishes pressure_target, all actuators, gauge [Pa], during a run
/// alone. Its mutex is locked before that of Recorder.
class RunAction {
 public:
  RunAction(ros::NodeHandle& node, ros::NodeHandle& private_node, const procedures::RunRules& rules,
            double rate, JobSlot& jobs, Recorder& recorder, Calibrator& calibrator)
      : rules_(rules),
        rate_(rate),
        jobs_(jobs),
        recorder_(recorder),
        calibrator_(calibrator),
        target_publisher_(node.advertise<PressureArray>(names::kPressureTarget, 10)),
        status_subscriber_(listen(node, names::kTargetStatus, 100, &RunAction::onStatus, this)),
        client_(private_node, names::kRunCalibration),
        server_(std::make_unique<Server>(
            private_node, names::kRunCalibration,
            [this](const RunCalibrationGoalConstPtr& goal) {
              goal_guard_.run("", [&] { onGoal(*goal); });
            },
            false)) {
    server_->start();
  }

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
  void onStatus(const TargetStatusConstPtr& status) HELIX_ARM_EXCLUDES(mutex_) {
    {
      const basics::MutexLock lock(mutex_);
      trace_.answered(*status);
    }
    if (status->commander != ros::this_node::getName() ||
        status->outcome != TargetStatus::DROPPED) {
      return;
    }
    const std::string message = basics::quoted(status->message, kLongestMessage);
    const basics::MutexLock lock(mutex_);
    if (!motion_) return;
    if (status->fault == control::nameOf(control::Fault::kOtherCommander)) {
      motion_->run.yield(message);
    } else if (status->fault != control::nameOf(control::Fault::kStale)) {
      motion_->run.end(procedures::RunEnd::kAborted,
                       "pressure_command refused a target: " + message);
    } else if (stale_targets_.add()) {
      // The next target may be in time. If none is, the arm vents, and that ends the run.
      logWarning("%s", message.c_str());
    }
  }

  // Thread of the action.
  void onGoal(const RunCalibrationGoal& goal) HELIX_ARM_EXCLUDES(mutex_) {
    std::optional<JobSlot::Claim> claim;
    RunCalibrationResult refused;
    refused.held_out_error = std::numeric_limits<double>::quiet_NaN();
    answer(names::kRunCalibration, refused, [&] {
      claim.emplace(jobs_, JobSlot::Job::kRun);
      begin(goal);
      refused.success = true;
      refused.message = "begins";
    });
    if (!refused.success) {
      claim.reset();
      server_->setAborted(refused, refused.message);
      return;
    }
    std::string why;
    if (!goal_guard_.run(
            "",
            [&] {
              client_.watchNext(goal);
              client_.beginNext();
              const auto ending = play();
              client_.release();
              recorder_.stopSeries();
              if (!ending) return;
              rest();
              conclude(goal, *ending);
            },
            &why) &&
        server_->isActive()) {
      refused.success = false;
      server_->setAborted(refused, why);
    }
    const basics::MutexLock lock(mutex_);
    motion_.reset();
  }

  /// @throws std::exception with the reason where the run cannot begin.
  void begin(const RunCalibrationGoal& goal) HELIX_ARM_EXCLUDES(mutex_) {
    calibrator_.check(goal.fit);
    calibrator_.scenePath(goal.out);  // otherwise refused only after a long run
    procedures::RunRules rules = rules_;
    rules.captures = goal.captures_per_pressure == 0 ? kUsualCaptures : goal.captures_per_pressure;
    rules.validate();
    const bool fits_response =
        estimation::fitParametersOf(goal.fit, true).count(estimation::FitParameter::kResponse) > 0;
    basics::require(
        goal.loop || !fits_response,
        "response is fitted to a series that only a run with loop records; set loop: true");
    basics::require(target_publisher_.getNumSubscribers() > 0,
                    "pressure_target has no subscriber; is pressure_command running?");
    basics::require(!EndRequest::made(), "the node is shutting down");
    const io::Scene scene = recorder_.scene();
    basics::require(scene.camera && scene.tags, "scene ", scene.name,
                    " has no `camera` or no `tags`, so nothing can be recorded; add them to it");
    const auto plan = procedures::checkPlan(scene.arm, goal.plan, goal.loop);
    if (const auto* refusal = std::get_if<control::Refusal>(&plan)) {
      throw std::invalid_argument(refusal->message);
    }
    const procedures::Settling state = recorder_.observe().settling;
    basics::require(!state.stale(), state.reason);
    basics::require(state.set_point.has_value(),
                    "no pressure_command was received yet; is its node running?");
    const basics::MutexLock lock(mutex_);
    motion_.emplace(Motion{scene.arm,
                           {std::get<Eigen::MatrixXd>(plan), scene.arm.clamped(*state.set_point),
                            scene.arm.inputAt(0), rules}});
    trace_ = {};
    recorder_.clear();
    if (goal.loop) recorder_.startSeries();
    calibrator_.forgetLast();
  }

  /// Moves the arm until the run has ended; absent where ROS was shut down before.
  std::optional<Ending> play() HELIX_ARM_EXCLUDES(mutex_) {
    const auto period = std::chrono::duration_cast<std::chrono::steady_clock::duration>(
        std::chrono::duration<double>(1.0 / rate_));
    std::vector<procedures::Sample> captures;  // of this step
    std::chrono::steady_clock::time_point due = std::chrono::steady_clock::now(),
                                          told = due - std::chrono::hours(1);
    while (ros::ok()) {
      const Turn done = turn(captures);
      if (done.ending) return done.ending;
      const auto now = std::chrono::steady_clock::now();
      if (std::chrono::duration<double>(now - told).count() > kFeedbackPeriod) {
        told = now;
        server_->publishFeedback(done.feedback);
      }
      due = std::max(due + period, now);
      std::this_thread::sleep_until(due);
    }
    return std::nullopt;
  }

  /// @param captures  Of this step so far; goes on.
  Turn turn(std::vector<procedures::Sample>& captures) HELIX_ARM_EXCLUDES(mutex_) {
    using procedures::RunEnd;
    const basics::MutexLock lock(mutex_);
    procedures::CalibrationRun& run = motion_->run;
    const auto [now, time_stands, state] = recorder_.observe();
    if (server_->isPreemptRequested()) run.end(RunEnd::kPreempted, "cancelled");
    if (EndRequest::made()) run.end(RunEnd::kAborted, "the node is shutting down");
    if (client_.isGone()) run.end(RunEnd::kAborted, client_.whyGone());
    if (time_stands) {
      run.end(RunEnd::kAborted,
              "ROS time does not advance; is the node that publishes /clock running?");
    }
    Turn out;
    if (run.ended()) {
      out.ending = Ending{run.verdict(), run.reason(), run.steps()};
      return out;
    }
    const procedures::CalibrationRun::Order order = run.advance(now, state);
    std_msgs::Header header = toHeaderMsg(ros::Time::now());
    target_publisher_.publish(toPressureMsg(header, motion_->arm, order.pressure));
    trace_.sent(header.stamp);
    if (order.capture) captures.push_back(*order.capture);
    if (order.step_done) {
      recorder_.add(medianOf(captures));
      captures.clear();
    }
    out.feedback.step = static_cast<std::uint32_t>(run.step() + 1);
    out.feedback.steps = static_cast<std::uint32_t>(run.steps());
    out.feedback.state = nameOf(run.phase());
    const bool waits = run.waitsForPictures();
    if (waits || (run.phase() == procedures::RunPhase::kSettling && !state.settled())) {
      out.feedback.state += ": " + state.reason;
    }
    if (waits && !motion_->waited) {
      logWarning("run_calibration waits for pictures, at most %g s (~patience_s): %s",
                 rules_.patience, state.reason.c_str());
    }
    motion_->waited = waits;
    out.feedback.pressure.assign(order.pressure.begin(), order.pressure.end());
    out.feedback.samples = static_cast<std::uint32_t>(recorder_.count());
    return out;
  }

  /// Brings the arm to rest after a run, if it is still the run's and no other goal waits for it.
  void rest() HELIX_ARM_EXCLUDES(mutex_) {
    for (;;) {
      // Without a master, the call would block.
      if (EndRequest::isUrgent() || !ros::ok()) return;
      {
        const basics::MutexLock lock(mutex_);
        if (server_->isNewGoalAvailable()) return;
        if (!trace_.awaitsAnswer()) {
          if (!trace_.commands() && !trace_.wasRested()) return;
          break;
        }
      }
      std::this_thread::sleep_for(kBetweenLooks);
    }
    requestRest();
  }

  /// Calibrates where the run was completed, and sets the result.
  void conclude(const RunCalibrationGoal& goal, const Ending& ending) {
    RunCalibrationResult result;
    result.held_out_error = std::numeric_limits<double>::quiet_NaN();
    if (ending.verdict != procedures::RunEnd::kCompleted) {
      result.message = ending.reason;
      logWarning("run_calibration: %s", result.message.c_str());
      if (ending.verdict == procedures::RunEnd::kPreempted) {
        server_->setPreempted(result, result.message);
      } else {
        server_->setAborted(result, result.message);
      }
      return;
    }
    answer(names::kRunCalibration, result, [&] {
      const Recording recording = recorder_.recording();
      const procedures::CalibrationData data = recording.data();
      RunCalibrationFeedback feedback;
      feedback.step = feedback.steps = static_cast<std::uint32_t>(ending.steps);
      feedback.samples = static_cast<std::uint32_t>(recording.samples.size());
      feedback.state = "fitting";
      server_->publishFeedback(feedback);
      procedures::CalibrationRequest request;
      request.fit = goal.fit;
      request.date = procedures::utcNow();
      const auto cancelled = [this] { return server_->isPreemptRequested(); };
      const std::string out = calibrator_.scenePath(goal.out);
      fill(result, calibrator_.calibrate(request, data, out, cancelled), out);
    });
    if (!result.success && server_->isPreemptRequested()) {
      server_->setPreempted(result, result.message);
    } else if (result.success) {
      server_->setSucceeded(result, result.message);
    } else {
      server_->setAborted(result, result.message);
    }
  }

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

}  // namespace

std::shared_ptr<void> serveRuns(ros::NodeHandle& node, ros::NodeHandle& private_node,
                                const procedures::RunRules& rules, double rate, JobSlot& jobs,
                                Recorder& recorder, Calibrator& calibrator) {
  return std::make_shared<RunAction>(node, private_node, rules, rate, jobs, recorder, calibrator);
}

}  // namespace helix_arm::ros_bridge
