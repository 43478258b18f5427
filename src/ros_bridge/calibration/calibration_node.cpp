#include <exception>
#include <limits>
#include <system_error>
#include <variant>

#include <actionlib/server/simple_action_server.h>
#include <ros/init.h>
#include <ros/this_node.h>

#include "bag/bag_captures.hpp"
#include "helix_arm/Calibrate.h"
#include "helix_arm/ClearSamples.h"
#include "helix_arm/FitContraction.h"
#include "helix_arm/RecordSample.h"
#include "helix_arm/RunCalibrationAction.h"
#include "helix_arm/RunCalibrationActionGoal.h"
#include "helix_arm/Save.h"
#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/calibration/calibration_parameters.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/procedures/calibration_job.hpp"
#include "helix_arm/procedures/calibration_run.hpp"
#include "helix_arm/procedures/pressure_plan.hpp"
#include "helix_arm/procedures/settle_watch.hpp"
#include "recorder.hpp"
#include "ros_bridge/common/client_watch.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/common/goal_serializers.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/reload_server.hpp"
#include "ros_bridge/common/rest_request.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"

namespace ros::serialization {

template <>
struct Serializer<helix_arm::RunCalibrationActionGoal>
    : helix_arm::ros_bridge::GoalSerializer<helix_arm::RunCalibrationActionGoal> {};

}  // namespace ros::serialization

namespace helix_arm::ros_bridge {
namespace {

/// What the services of calibration and its action answer.

/// Runs what answers a service; what it throws is the answer.
/// @return true: the answer is sent.
template <class Response, class Body>
bool answer(const char* service, Response& response, const Body& body) {
  try {
    body();
  } catch (const std::exception& fault) {
    response.success = false;
    response.message = basics::printableLines(fault.what());
  }
  if (response.success) {
    logInfo("%s: %s", service, response.message.c_str());
  } else {
    logWarning("%s: %s", service, response.message.c_str());
  }
  return true;
}

/// Fills the response of the service or the result of the action.
/// @param path  Of the calibrated scene.
template <class Answer>
void fill(Answer& out, const procedures::CalibrationOutcome& outcome, const std::string& path) {
  out.success = outcome.success;
  out.message = outcome.message;
  out.warnings = outcome.warnings;
  out.held_out_error = std::numeric_limits<double>::quiet_NaN();
  constexpr double kUndetermined = std::numeric_limits<double>::quiet_NaN();
  out.tip_error_before = outcome.tip_error_before.value_or(kUndetermined);
  out.tip_error_after = outcome.tip_error_after.value_or(kUndetermined);
  if (outcome.success) out.out = path;
  for (const estimation::Parameter& parameter : procedures::parametersOf(outcome)) {
    out.names.push_back(parameter.name);
    out.units.push_back(parameter.unit);
    out.initial.push_back(parameter.initial);
    out.values.push_back(parameter.value);
    out.standard_errors.push_back(parameter.standard_error);
    out.identifiable.push_back(parameter.identifiable);
  }
  if (outcome.response) {
    out.rms = outcome.response->fit.rms;
    out.error_unit = "m";
  }
  if (!outcome.calibration) return;
  const estimation::Calibration& calibration = *outcome.calibration;
  out.rms = calibration.rms;
  out.error_unit = calibration.error_unit;
  if (calibration.by_pressure) out.held_out_error = calibration.by_pressure->error;
  for (const Eigen::VectorXd& row : calibration.next_pressures) {
    out.next_pressures.insert(out.next_pressures.end(), row.begin(), row.end());
  }
}

/// The one long job that the calibration node does at a time: a run of its action, or the fit of a
/// service. While a job holds the slot, no other starts, and neither samples nor scene are changed
/// from outside. From any thread.
///
/// Its mutex is locked after that of ReloadServer, and before those of Recorder and Calibrator.
class JobSlot {
 public:
  enum class Job {
    kNone,
    kRun,  ///< run_calibration
    kFit,  ///< the fit of a service
  };

  /// Holds the slot until its last copy ends.
  using Claim = std::shared_ptr<void>;

  /// @throws std::invalid_argument naming the job that is under way.
  Claim claim(Job job) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    requireIdle();
    job_ = job;
    return Claim(nullptr, [this](void*) {
      const basics::MutexLock end(mutex_);
      job_ = Job::kNone;
    });
  }

  /// run_calibration is under way
  bool runs() const HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    return job_ == Job::kRun;
  }

  /// Runs a short body; no job starts meanwhile.
  /// @return what the body returns.
  /// @throws std::invalid_argument naming the job that is under way, and what the body throws.
  template <class Body>
  auto whileIdle(const Body& body) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    requireIdle();
    return body();
  }

 private:
  void requireIdle() const HELIX_ARM_REQUIRES(mutex_) {
    basics::require(job_ != Job::kRun,
                    "run_calibration is running; wait for it, or cancel it first");
    basics::require(job_ != Job::kFit, "a fit is running; wait for it");
  }

  mutable basics::Mutex mutex_;
  Job job_ HELIX_ARM_GUARDED_BY(mutex_) = Job::kNone;
};

void makeFolder(const std::string& folder) {
  std::error_code fault;
  std::filesystem::create_directories(folder, fault);
  if (fault) {
    logWarning(
        "the folder %s does not exist and cannot be created (%s): services cannot use files in it",
        folder.c_str(), fault.message().c_str());
  }
}

/// Reads data sets, fits the file of the node's scene, writes the calibrated scene, and keeps the
/// last one. From any thread; no file is read or written and nothing is fitted under its lock.
class Calibrator {
 public:
  using SceneFile = std::function<ReloadServer::File()>;

  /// Makes the folders where they are missing; warns where that fails.
  ///
  /// @param data_folder, out_folder  Data sets are read below both; scenes and samples are written
  ///                                 below the second.
  /// @param rules       When the arm of a recording stands still.
  /// @param scene_file  The file of the node's scene.
  Calibrator(const std::string& data_folder, const std::string& out_folder,
             const procedures::SettleRules& rules, SceneFile scene_file)
      : data_access_({{data_folder, "~data_folder"}, {out_folder, "~out_folder"}}),
        out_access_({{out_folder, "~out_folder"}}),
        rules_(rules),
        scene_file_(std::move(scene_file)) {
    makeFolder(data_folder);
    makeFolder(out_folder);
  }

  // Paths without links, of what a request names.
  // Each throws std::invalid_argument where the node may not read or write it.
  /// of a data set to read (.csv)
  std::string tablePath(const std::string& data) const {
    return data_access_.toRead("data", data, {".csv"});
  }

  /// Where a calibrated scene goes; empty stays empty.
  std::string scenePath(const std::string& out) const {
    return out.empty() ? out : out_access_.toWrite("out", out, {".yaml"});
  }

  /// of a scene or of samples to write
  std::string savePath(const std::string& path) const {
    return out_access_.toWrite("path", path, {".yaml", ".csv"});
  }

  /// Reads data sets of all kinds, recordings included.
  /// @throws std::invalid_argument where one may not be read, io::DocumentError with every fault of
  /// a file.
  procedures::CalibrationData load(const io::Scene& scene,
                                   const std::vector<std::string>& paths) const {
    std::vector<std::string> allowed;
    for (const std::string& path : paths) {
      allowed.push_back(data_access_.toRead("data", path, {".csv", ".bag"}));
    }
    return loadMeasurements(scene, allowed, rules_);
  }

  /// @throws std::invalid_argument where the words are none of CalibrationRequest::fit,
  /// DocumentError where the scene has faults.
  void check(const std::vector<std::string>& fit) const {
    // An unknown word throws; missing data does not.
    procedures::CalibrationRequest request;
    request.fit = fit;
    procedures::runCalibration(scene_file_().path, {}, request, {});
  }

  /// Fits, and writes the scene when there is a path and nobody has cancelled it meanwhile.
  ///
  /// @param out        As scenePath() returned it; checked again before the scene is written.
  /// @param cancelled  Asked once, after the fit.
  /// @throws std::invalid_argument where the scene's file has changed since it was loaded, and as
  /// procedures::runCalibration().
  procedures::CalibrationOutcome calibrate(const procedures::CalibrationRequest& request,
                                           const procedures::CalibrationData& data,
                                           const std::string& out,
                                           const std::function<bool()>& cancelled)
      HELIX_ARM_EXCLUDES(mutex_) {
    const ReloadServer::File file = scene_file_();
    basics::require(io::sha256OfFile(file.path) == file.sha256, file.path,
                    " changed on disk since it was loaded; call reload first");
    procedures::CalibrationOutcome outcome =
        procedures::runCalibration(file.path, {}, request, data);
    if (!outcome.success) return outcome;
    if (cancelled()) {
      outcome.success = false;
      outcome.message = "cancelled";
      return outcome;
    }
    {
      const basics::MutexLock lock(mutex_);
      last_ = outcome.scene_text;
    }
    if (out.empty()) return outcome;
    try {
      io::writeFileAtomically(scenePath(out), outcome.scene_text);
    } catch (const std::exception& fault) {
      outcome.success = false;
      outcome.message +=
          ", but it is not saved: " + std::string(fault.what()) + "; call save with another path";
    }
    return outcome;
  }

  /// Text of the last scene that was calibrated; absent where there is none.
  std::optional<std::string> last() const HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    return last_;
  }

  void forgetLast() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    last_.reset();
  }

 private:
  const FileAccess data_access_, out_access_;
  const procedures::SettleRules rules_;
  const SceneFile scene_file_;
  mutable basics::Mutex mutex_;
  std::optional<std::string> last_ HELIX_ARM_GUARDED_BY(mutex_);
};

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
    JobSlot::Claim claim;
    RunCalibrationResult refused;
    refused.held_out_error = std::numeric_limits<double>::quiet_NaN();
    answer(names::kRunCalibration, refused, [&] {
      claim = jobs_.claim(JobSlot::Job::kRun);
      begin(goal);
      refused.success = true;
      refused.message = "begins";
    });
    if (!refused.success) {
      claim.reset();
      return end(refused, false);
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
      refused.message = why;
      end(refused, false);
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
      return end(result, ending.verdict == procedures::RunEnd::kPreempted);
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
    end(result, server_->isPreemptRequested());
  }

  void end(const RunCalibrationResult& result, bool preempted) {
    const auto set = result.success ? &Server::setSucceeded
                     : preempted    ? &Server::setPreempted
                                    : &Server::setAborted;
    (*server_.*set)(result, result.message);
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

template <class Value>
Value wordOf(const char* what, const std::string& given,
             const std::vector<std::pair<const char*, Value>>& words) {
  if (given.empty()) return words.front().second;
  std::string list;
  for (const auto& [word, value] : words) {
    if (given == word) return value;
    list += (list.empty() ? "" : " or ") + std::string(word);
  }
  throw std::invalid_argument(std::string(what) + " is '" + basics::quoted(given) + "'; expected " +
                              list);
}

procedures::CalibrationRequest requestOf(const Calibrate::Request& request) {
  procedures::CalibrationRequest out;
  out.fit = request.fit;
  out.curvature_noise = request.curvature_noise_rad;
  out.corner_noise = request.corner_noise_px;
  out.position_noise = request.position_noise_m;
  out.rotation_noise = request.rotation_noise_rad;
  out.date = procedures::utcNow();
  return out;
}

procedures::CalibrationRequest requestOf(const FitContraction::Request& request) {
  using estimation::Branch;
  using estimation::CurveKind;
  procedures::CalibrationRequest out;
  out.fit = {"contraction"};
  out.contraction = request.contraction;
  out.curve = wordOf<CurveKind>("kind", request.kind,
                                {{"quintic", CurveKind::kQuintic}, {"table", CurveKind::kTable}});
  out.branch = wordOf<Branch>(
      "branch", request.branch,
      {{"both", Branch::kBoth}, {"rising", Branch::kRising}, {"falling", Branch::kFalling}});
  out.date = procedures::utcNow();
  return out;
}

void fillCurve(FitContraction::Response& response, const estimation::ContractionFit& fit) {
  if (!fit.curve) return;
  response.rms = fit.rms;
  response.constrained = fit.constrained;
  if (fit.hysteresis) response.hysteresis = *fit.hysteresis;
  if (fit.kind == estimation::CurveKind::kQuintic) {
    response.coefficients.assign(fit.coefficients.begin(), fit.coefficients.end());
    response.reference_pressure = fit.reference_pressure;
  } else {
    response.pressures = fit.pressures;
    response.lengths = fit.lengths;
  }
}

bool neverCancelled() { return false; }

/// Private parameters of calibration.
struct CalibrationNodeOptions {
  ParameterReader reader{ros::NodeHandle("~")};
  std::string scene = reader.file("scene", "config/scenes", ".yaml");  ///< as pressure_command's
  procedures::SettleRules settle;  ///< when the arm stands still, and when measurements are stale
  procedures::RunRules run;        ///< of run_calibration, except the captures
  double rate = 50.0;              ///< of the targets during run_calibration [Hz]
  std::string scene_folder;        ///< as pressure_command's
  /// Below which data sets are read (of either), and scenes and samples are written (of the
  /// second); made where they are missing.
  std::string data_folder, out_folder;

  CalibrationNodeOptions() {
    settle.pressure_tolerance = 1e3 * reader.number("pressure_tolerance_kpa",
                                                    1e-3 * settle.pressure_tolerance, {0.01, 100});
    settle.corner_tolerance =
        reader.number("corner_tolerance_px", settle.corner_tolerance, {0.01, 100});
    settle.window = reader.number("window_s", settle.window, {0.05, 60});
    settle.max_age = reader.number("max_age_s", settle.max_age, {0.05, 60});
    run.ramp = 1e3 * reader.number("ramp_kpa_s", 1e-3 * run.ramp, {0.1, 10000});
    run.patience = reader.number("patience_s", run.patience, {0.1, 3600});
    rate = reader.number("rate", rate, {5, 1000});
    scene_folder = reader.folder("scene_folder", defaultFolder());
    data_folder = reader.folder("data_folder", defaultFolder());
    out_folder = reader.folder("out_folder", defaultFolder());
    reader.finish();
  }
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
class CalibrationNode : public Node {
 public:
  CalibrationNode()
      : recorder_(node_, requirePneumatic(io::loadScene(options_.scene)), options_.settle),
        calibrator_(options_.data_folder, options_.out_folder, options_.settle,
                    [this] { return reload_.file(); }),
        calibrate_(serve(private_node_, names::kCalibrate, &Self::onCalibrate, this)),
        fit_contraction_(
            serve(private_node_, names::kFitContraction, &Self::onFitContraction, this)),
        record_(serve(private_node_, names::kRecordSample, &Self::onRecord, this)),
        clear_(serve(private_node_, names::kClearSamples, &Self::onClear, this)),
        save_(serve(private_node_, names::kSave, &Self::onSave, this)),
        reload_(private_node_, options_.scene, options_.scene_folder,
                [this](io::Scene next) { adopt(std::move(next)); }),
        run_(node_, private_node_, options_.run, options_.rate, jobs_, recorder_, calibrator_) {
    const io::Scene scene = recorder_.scene();
    logInfo("%s: %s", scene.name.c_str(),
            scene.camera && scene.tags
                ? "ready to record and to calibrate"
                : "ready to calibrate from data sets; its scene lacks `camera` or `tags`, so "
                  "nothing can be recorded");
  }

  /// Not while run_calibration is under way: the arm is to be ramped down first.
  bool mayEnd() const override { return !jobs_.runs(); }

 private:
  using Self = CalibrationNode;

  // Services. While run_calibration is under way, each is refused.
  bool onCalibrate(Calibrate::Request& request, Calibrate::Response& response) {
    response.held_out_error = std::numeric_limits<double>::quiet_NaN();
    return answer(names::kCalibrate, response, [&] {
      const std::string out = calibrator_.scenePath(request.out);
      const JobSlot::Claim fit = jobs_.claim(JobSlot::Job::kFit);
      const procedures::CalibrationData data =
          request.data.empty() ? recorder_.recording().data()
                               : calibrator_.load(recorder_.scene(), request.data);
      fill(response, calibrator_.calibrate(requestOf(request), data, out, neverCancelled), out);
    });
  }

  bool onFitContraction(FitContraction::Request& request, FitContraction::Response& response) {
    response.hysteresis = std::numeric_limits<double>::quiet_NaN();
    return answer(names::kFitContraction, response, [&] {
      const procedures::CalibrationRequest job = requestOf(request);
      const std::string path = calibrator_.tablePath(request.data);
      const std::string out = calibrator_.scenePath(request.out);
      const JobSlot::Claim fit = jobs_.claim(JobSlot::Job::kFit);
      const procedures::CalibrationData data =
          procedures::loadCalibrationData(recorder_.scene(), {path});
      basics::require(!data.lengths.empty(), path,
                      " holds no free lengths; expected the columns pressure_kpa and length_m");
      const procedures::CalibrationOutcome outcome =
          calibrator_.calibrate(job, data, out, neverCancelled);
      response.success = outcome.success;
      response.message = outcome.message;
      if (outcome.success) response.out = out;
      if (!outcome.contractions.empty()) {
        fillCurve(response, outcome.contractions.front().second);
      }
    });
  }

  bool onRecord(RecordSample::Request&, RecordSample::Response& response) {
    return answer(names::kRecordSample, response, [&] {
      response.samples = static_cast<std::uint32_t>(recorder_.count());
      jobs_.whileIdle([&] {
        const procedures::Sample sample = recorder_.record();
        response.samples = static_cast<std::uint32_t>(recorder_.count());
        response.tags = static_cast<std::uint32_t>(sample.tags.size());
        response.pressure.assign(sample.pressure.begin(), sample.pressure.end());
      });
      response.success = true;
      response.message = "sample " + std::to_string(response.samples) + " with " +
                         std::to_string(response.tags) + " tags";
    });
  }

  bool onClear(ClearSamples::Request&, ClearSamples::Response& response) {
    return answer(names::kClearSamples, response, [&] {
      jobs_.whileIdle([&] {
        response.cleared = static_cast<std::uint32_t>(recorder_.clear());
        calibrator_.forgetLast();
      });
      response.success = true;
      response.message = std::to_string(response.cleared) + " samples cleared";
    });
  }

  bool onSave(Save::Request& request, Save::Response& response) {
    return answer(names::kSave, response, [&] {
      const std::string path = calibrator_.savePath(request.path);
      const auto [recording, last] =
          jobs_.whileIdle([&] { return std::pair(recorder_.recording(), calibrator_.last()); });
      std::string text;
      if (std::filesystem::path(path).extension() == ".csv") {
        basics::require(!recording.samples.empty(),
                        "no sample was recorded; call record_sample first");
        text = recording.table();
        response.message = std::to_string(recording.samples.size()) + " samples in " + path;
        if (!recording.series.empty()) {
          const std::string beside = calibrator_.savePath(
              std::filesystem::path(path).replace_extension().string() + "_series.csv");
          io::writeFileAtomically(beside, recording.seriesTable());
          response.message += " and a series of " +
                              std::to_string(recording.series.history.rows()) + " rows in " +
                              beside;
        }
      } else {
        basics::require(last.has_value(), "nothing was calibrated; call calibrate first");
        text = *last;
        response.message = "the last calibration of " + recording.scene.name + " in " + path;
      }
      io::writeFileAtomically(path, text);
      response.success = true;
    });
  }

  void adopt(io::Scene next) {
    jobs_.whileIdle([&] {
      recorder_.adopt(std::move(next));
      calibrator_.forgetLast();
    });
  }

  const CalibrationNodeOptions options_{};
  ros::NodeHandle node_, private_node_{"~"};
  JobSlot jobs_;
  Recorder recorder_;
  Calibrator calibrator_;
  ros::ServiceServer calibrate_, fit_contraction_, record_, clear_, save_;
  ReloadServer reload_;
  RunAction run_;  ///< last: its thread uses all of the above
};

}  // namespace

std::unique_ptr<Node> makeCalibration() { return std::make_unique<CalibrationNode>(); }

}  // namespace helix_arm::ros_bridge
