#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <functional>
#include <future>
#include <list>
#include <map>
#include <memory>
#include <utility>

#include <actionlib/client/simple_action_client.h>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/callback_queue.h>
#include <ros/master.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>
#include <ros/steady_timer.h>

#include "basics/mutex.hpp"
#include "cockpit_view.hpp"
#include "helix_arm/ArmShape.h"
#include "helix_arm/ErrorBudget.h"
#include "helix_arm/LoopStatus.h"
#include "helix_arm/ModelError.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/RunCalibrationAction.h"
#include "helix_arm/RunExperimentAction.h"
#include "helix_arm/TargetStatus.h"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

template <class Result>
bool isReady(const std::future<Result>& result) {
  return result.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
}

/// Word of CockpitLink::startCalibration() for a walk, in place of words of a fit.
inline constexpr char kWalk[] = "walk";

/// Calls services in threads of their own, so that whoever asks is never blocked, and gives up on
/// those that do not answer in time.
///
/// Calls do not wait for each other: a service that hangs delays no emergency stop. A call that was
/// given up on may still end later; its answer is then dropped. For one thread, except the calls.
class ServiceCaller {
 public:
  /// Makes the call in a thread of its own; what it throws is the answer.
  using Call = std::function<CallAnswer()>;

  /// At most so many calls of one name wait for an answer; further ones are refused. Those given up
  /// on do not count: a fifth emergency stop still goes out to a node that has come back.
  static constexpr int kMostWaiting = 4;
  /// At most so many calls of one name have a thread, with those that were given up on.
  static constexpr int kMostRunning = 64;

  /// @param what     name of the call in its answer.
  /// @param limit    time in which it must answer, > 0 [s].
  /// @param call     Must not refer to anything that may end before it.
  /// @param remedy   of its answer, however the call fails.
  void ask(const std::string& what, double limit, Call call, const std::string& remedy = {});
  /// Whether a call of this name waits for its answer; one that was given up on does not.
  bool waits(const std::string& what) {
    look();
    return std::any_of(calls_.begin(), calls_.end(),
                       [&](const Running& one) { return one.what == what && !one.given_up; });
  }
  /// The answers since the last time: one per call that has ended or was given up on.
  std::vector<CallAnswer> take() {
    look();
    return std::exchange(answers_, {});
  }

 private:
  struct Running {
    std::string what, remedy;
    double limit;
    ros::SteadyTime due;
    std::future<CallAnswer> answer;
    bool given_up = false;
  };

  /// Takes the answers of calls that have ended, and gives up on those that are late.
  void look();
  void tell(CallAnswer answer, const std::string& remedy) {
    if (!answer.success) answer.remedy = remedy;
    answers_.push_back(std::move(answer));
  }

  std::list<Running> calls_;  ///< also those given up on
  std::vector<CallAnswer> answers_;
};

/// The target that the cockpit repeats: pressures or a tip. Decides when the repetition ends, so
/// that the cockpit never moves an arm again that vented, or that somebody else has. No clock:
/// times are arguments [s].
///
/// It ends when the arm is no longer enabled, when a target of it is refused for good, when another
/// commander keeps the arm for kPatience, when no target of it is answered for kUnanswered, as if
/// the node that takes them is gone, and when nobody has looked at the cockpit (look()) for kBlind,
/// as if the window hangs.
class HeldGoal {
 public:
  static constexpr double kPatience = 5.0;    ///< [s]
  static constexpr double kBlind = 3.0;       ///< [s]
  static constexpr double kUnanswered = 5.0;  ///< [s]

  /// (n) gauge [Pa]
  void holdPressures(double now, std::vector<double> pressure) {
    begin(now, CockpitGoal::kPressures);
    state_.held = std::move(pressure);
  }
  /// base frame [m]
  void holdTip(double now, const std::array<double, 3>& position) {
    begin(now, CockpitGoal::kTip);
    state_.tip = position;
  }
  /// @param why  shown to the user; may be empty.
  /// @param refused  whether its targets are not taken.
  void end(const std::string& why, bool refused = false) {
    if (!holds()) return;
    note(CockpitGoal::kNone, why, refused);
    waits_since_.reset();
  }

  const CockpitHold& state() const { return state_; }
  bool holds() const { return state_.goal != CockpitGoal::kNone; }

  /// The window is alive.
  void look(double now) { last_look_ = now; }
  /// The state of the arm.
  void noteState(bool enabled, const std::string& reason) {
    if (!enabled) end("the hold ended with the arm: " + reason);
  }
  /// An answer to one of its targets.
  /// @param dropped  whether it was dropped.
  /// @param fault    of a dropped target: other_commander, stale, ...
  /// @param short_of  the target is out of reach; what is nearest to it is commanded.
  void noteAnswer(double now, bool dropped, const std::string& fault, const std::string& message,
                  bool short_of = false) {
    if (!holds()) return;
    answered_at_ = now;
    note(state_.goal, message, dropped, short_of);
    if (!dropped) {
      waits_since_.reset();
    } else if (fault == "other_commander") {
      if (!waits_since_) waits_since_ = now;
    } else if (fault != "stale") {  // the next one may be in time
      end(message, true);
    }
  }
  /// Ends the goal if a deadline has passed. @return whether a target is to be sent now.
  bool turn(double now) {
    if (now - last_look_ > kBlind) {
      end("the hold ended: the window did not respond");
    } else if (now - answered_at_ > kUnanswered) {
      end("the hold ended: nothing answers its targets; is the node that takes them alive?", true);
    } else if (waits_since_ && now - *waits_since_ > kPatience) {
      end("another commander keeps the arm: " + state_.answer, true);
    }
    return holds();
  }

 private:
  void begin(double now, CockpitGoal goal) {
    if (!holds()) waits_since_.reset();
    if (state_.goal != goal) answered_at_ = now;  // a slider that is dragged on is no answer
    last_look_ = now;
    note(goal, "", false);
  }
  void note(CockpitGoal goal, const std::string& answer, bool refused, bool short_of = false) {
    state_.goal = goal;
    state_.answer = answer;
    state_.refused = refused;
    state_.short_of = short_of;
  }

  CockpitHold state_;
  double last_look_ = 0;
  double answered_at_ = 0;             ///< or begun [s]
  std::optional<double> waits_since_;  ///< for another commander
};

/// The runs of an action of another node, one at a time. From any thread.
/// @tparam Run  a CockpitRun.
template <class Action, class Run>
class ActionRuns {
 public:
  using Goal = typename Action::_action_goal_type::_goal_type;

  /// @param action  name, below the node's. @param what  the node is called, such as "calibration".
  ActionRuns(ros::NodeHandle& node, const std::string& action, const char* what)
      : what_(what), client_(node, action, false) {}

  /// Without effect while a run is under way, or where no node takes it.
  void start(const Goal& goal) HELIX_ARM_EXCLUDES(mutex_);
  void cancel() { client_.cancelGoal(); }
  /// The present or the last run. @param now  by a steady clock [s].
  Run view(double now) HELIX_ARM_EXCLUDES(mutex_);

 private:
  using Client = actionlib::SimpleActionClient<Action>;
  using Result = decltype(Run::result);
  using Feedback = decltype(Run::progress);

  static constexpr double kPatience = 1.0;  ///< for a node that is gone [s]

  /// @param run  of the action, as runs_ was at its start. What it says after it was given up on
  /// does not count.
  bool isUnderWay(std::uint64_t run) const HELIX_ARM_REQUIRES(mutex_) {
    return run == runs_ && run_.running;
  }

  basics::Mutex mutex_;
  Run run_ HELIX_ARM_GUARDED_BY(mutex_);
  std::uint64_t runs_ HELIX_ARM_GUARDED_BY(mutex_) = 0;  ///< that were started
  double seen_ HELIX_ARM_GUARDED_BY(mutex_) = 0;         ///< when its node was there [s]
  const std::string what_;
  Client client_;  ///< last: its callbacks use the others
};

/// One arm, as a user of its topics and services: what the cockpit shows, and what its buttons do.
///
/// Once it is made, no call blocks. Topics have a thread of their own, services are called through
/// a ServiceCaller, and the target that is held is repeated at 10 Hz for as long as view() is
/// called.
///
/// Calls may overtake each other, and one that hangs may arrive late. None of them undoes a stop or
/// a vent that was asked for after it: what has not been sent yet is not sent, and what has is
/// followed by another stop or vent.
class CockpitLink {
 public:
  /// Waits for the ROS master, without end where that is gone or hangs; see LinkBuilder.
  /// @param ns  Namespace of the arm's nodes, such as left; empty: that of this node.
  /// @throws ros::InvalidNameException if the namespace is no name.
  explicit CockpitLink(const std::string& ns);
  /// The same namespace from the root, such as / or /left. Asks nobody.
  /// @throws ros::InvalidNameException if it is no name.
  static std::string resolved(const std::string& ns) {
    const std::string out = ros::NodeHandle(ns).getNamespace();
    return out.empty() ? "/" : out;  // roscpp's root
  }
  ~CockpitLink() {
    spinner_.stop();
    timer_.stop();
    calibration_.reset();
    experiment_.reset();
    subscribers_.clear();
  }

  /// The present moment; also tells that somebody still looks.
  CockpitView view() HELIX_ARM_EXCLUDES(mutex_);

  /// Answers of the services that came since the last call.
  std::vector<CallAnswer> takeAnswers() { return caller_.take(); }

  /// Without effect while such a call waits for its answer, as for Release and useCalibration().
  void enable() {
    askUnlessOvertaken("Enable", &Asked::vents, triggers(names::kEnable), triggers(names::kVent));
  }
  void vent() HELIX_ARM_EXCLUDES(mutex_);
  void emergencyStop(bool engage) HELIX_ARM_EXCLUDES(mutex_);
  /// True: holds the present command. False: lets go of the arm, which ramps down to rest.
  void hold(bool on) HELIX_ARM_EXCLUDES(mutex_);
  /// Holds the present command, with this one changed.
  /// @param channel  index in scene order.
  void setPressure(std::size_t channel, double pressure) HELIX_ARM_EXCLUDES(mutex_);
  /// Holds this tip, base frame [m].
  void aimTip(const std::array<double, 3>& position) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    held_.holdTip(now(), position);
    send();
  }
  /// Asks for the forces that a tip carries there, base frame [m].
  void askPayload(const std::array<double, 3>& position);
  /// @param fit  as in RunCalibration; kWalk alone: its walk.
  void startCalibration(const std::vector<std::string>& fit);
  void cancelCalibration() { calibration_->cancel(); }
  /// @param name  as in RunExperiment.
  void startExperiment(const std::string& name);
  void stopExperiment() { experiment_->cancel(); }
  /// Saves the calibrated scene and loads it in all nodes of the arm.
  void useCalibration();

 private:
  /// How often a stop, and a vent or stop, was asked for. Shared with calls that hang.
  struct Asked {
    std::atomic<std::uint64_t> stops{0}, vents{0};
  };

  static constexpr double kFresh = 1.0;  ///< older values are unknown [s]

  static double now() { return ros::SteadyTime::now().toSec(); }

  /// The last message of a topic that counts.
  template <class Message>
  struct Heard {
    Message last;
    double came = -std::numeric_limits<double>::infinity();  ///< [s]

    bool isFresh(double longest = kFresh) const { return now() - came < longest; }
  };
  /// Subscribes.
  /// @param heard   Where the last message is kept; null: nowhere.
  /// @param counts  called with the lock; returns whether a message counts. Null: all do.
  template <class Message>
  void hear(const char* topic, Heard<Message> CockpitLink::*heard,
            bool (CockpitLink::*counts)(const Message&) = nullptr);
  bool onCommand(const PressureArray& message) HELIX_ARM_REQUIRES(mutex_);
  bool onReading(const PressureArray& message) HELIX_ARM_REQUIRES(mutex_);
  bool onSafety(const SafetyState& message) HELIX_ARM_REQUIRES(mutex_);
  bool onStatus(const TargetStatus& message) HELIX_ARM_REQUIRES(mutex_);
  bool onDiagnostics(const diagnostic_msgs::DiagnosticArray& message) HELIX_ARM_REQUIRES(mutex_);

  void send() HELIX_ARM_REQUIRES(mutex_);
  std::vector<CockpitChannel> channels() const HELIX_ARM_REQUIRES(mutex_);

  // Calls of the services of pressure_command.
  std::string serviceOf(const char* name) const {
    return node_.resolveName(std::string(names::kPressureCommandNode) + "/" + name);
  }
  ServiceCaller::Call triggers(const char* service) const;
  ServiceCaller::Call stops(bool engage) const;
  /// Asks for a call that a later wish of the user takes back: it is not sent, if there is still
  /// time, or undone.
  void askUnlessOvertaken(const char* what, std::atomic<std::uint64_t> Asked::*later,
                          const ServiceCaller::Call& call, const ServiceCaller::Call& undo);

  ServiceCaller caller_;
  const std::shared_ptr<Asked> asked_ = std::make_shared<Asked>();
  ros::CallbackQueue queue_;
  ros::NodeHandle node_;
  ros::Publisher pressure_publisher_, tip_publisher_;

  basics::Mutex mutex_;
  CockpitView seen_ HELIX_ARM_GUARDED_BY(mutex_);  ///< but what is heard
  Heard<PressureArray> command_ HELIX_ARM_GUARDED_BY(mutex_), reading_ HELIX_ARM_GUARDED_BY(mutex_);
  Heard<SafetyState> safety_ HELIX_ARM_GUARDED_BY(mutex_);
  Heard<ArmShape> measured_ HELIX_ARM_GUARDED_BY(mutex_), model_ HELIX_ARM_GUARDED_BY(mutex_);
  Heard<ModelError> error_ HELIX_ARM_GUARDED_BY(mutex_);
  Heard<LoopStatus> loop_ HELIX_ARM_GUARDED_BY(mutex_);
  Heard<ErrorBudget> budget_ HELIX_ARM_GUARDED_BY(mutex_);
  std::map<std::string, std::array<double, 2>> limits_ HELIX_ARM_GUARDED_BY(mutex_);  ///< [Pa]
  HeldGoal held_ HELIX_ARM_GUARDED_BY(mutex_);

  std::vector<ros::Subscriber> subscribers_;
  std::unique_ptr<ActionRuns<RunCalibrationAction, CockpitCalibration>> calibration_;
  std::unique_ptr<ActionRuns<RunExperimentAction, CockpitExperiment>> experiment_;
  ros::SteadyTimer timer_;
  ros::AsyncSpinner spinner_;
};

/// Makes and ends a CockpitLink in threads of its own: both ask the ROS master, and whoever asks
/// for a link must not wait for one that is gone or hangs. No function waits.
class LinkBuilder {
 public:
  /// An attempt under way ends in its own time.
  ~LinkBuilder() { cancel(); }

  /// Begins to connect to the arm of this namespace as soon as the master answers, in place of any
  /// other arm.
  /// @throws ros::InvalidNameException if the namespace is no name; what is under way goes on.
  void begin(const std::string& ns);
  /// Gives up on what is under way.
  void cancel();

  /// The link once it is there, once; null otherwise.
  /// @throws what its constructor threw.
  std::unique_ptr<CockpitLink> take() {
    return made_.valid() && isReady(made_) ? made_.get() : nullptr;
  }

  /// Resolved namespace of the arm to which a connection is under way; empty if there is none.
  std::string connectingTo() const { return made_.valid() && !isReady(made_) ? attempt_->ns : ""; }
  /// URI of the ROS master if that connection waits for it; empty otherwise.
  std::string silentMaster() const {
    return attempt_ && attempt_->silent ? ros::master::getURI() : "";
  }

  /// Ends a link.
  static void end(std::unique_ptr<CockpitLink> link);

 private:
  /// State that its thread, which may outlive the builder, shares with it.
  struct Attempt {
    std::string ns;  ///< resolved
    std::atomic<bool> cancelled{false}, silent{false};
  };

  std::shared_ptr<Attempt> attempt_;                ///< the last one; null if it was given up on
  std::future<std::unique_ptr<CockpitLink>> made_;  ///< by it; not valid once it was taken
};

}  // namespace helix_arm::ros_bridge
