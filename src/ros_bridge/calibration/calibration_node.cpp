#include <Eigen/Core>
#include <exception>
#include <system_error>
#include <variant>

#include <actionlib/server/simple_action_server.h>
#include <ros/init.h>

#include "bag/bag_captures.hpp"
#include "helix_arm/Calibrate.h"
#include "helix_arm/ClearSamples.h"
#include "helix_arm/FitContraction.h"
#include "helix_arm/RecordSample.h"
#include "helix_arm/RunCalibrationAction.h"
#include "helix_arm/RunCalibrationActionGoal.h"
#include "helix_arm/Save.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/VisionStatus.h"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/calibration/calibration_parameters.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/procedures/calibration_job.hpp"
#include "helix_arm/procedures/calibration_run.hpp"
#include "helix_arm/procedures/captures.hpp"
#include "helix_arm/procedures/pressure_plan.hpp"
#include "helix_arm/procedures/response_series.hpp"
#include "helix_arm/procedures/settle_watch.hpp"
#include "ros_bridge/common/client_watch.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/common/goal_serializers.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/reload_server.hpp"
#include "ros_bridge/common/rest_request.hpp"
#include "ros_bridge/names.hpp"

namespace ros::serialization {

template <>
struct Serializer<helix_arm::RunCalibrationActionGoal>
    : helix_arm::ros_bridge::GoalSerializer<helix_arm::RunCalibrationActionGoal> {};

}  // namespace ros::serialization

namespace helix_arm::ros_bridge {
namespace {

/// The samples that were recorded of an arm, and its scene.
struct Recording {
  io::Scene scene;
  std::vector<procedures::Sample> samples;
  procedures::ResponseSeries series;      ///< of a run in a loop; empty without one
  std::size_t left_out = 0;               ///< rows that the series has no room for
  std::optional<std::string> calibrated;  ///< text of the last scene that was calibrated

  /// What a calibration takes.
  /// @throws std::invalid_argument without samples, io::DocumentError as
  /// procedures::makeCaptures().
  procedures::CalibrationData data() const {
    const std::vector<io::TagCornerCapture> seen = numbered(samples, scene.arm);
    basics::require(
        !seen.empty(),
        "no sample was recorded; call record_sample or run_calibration first, or name data "
        "sets");
    procedures::CalibrationData out;
    out.captures = procedures::makeCaptures(scene, seen, "recorded samples").captures;
    out.sources.push_back({"recorded samples",
                           io::sha256Of(io::tagCornerCsv(seen, scene.arm.actuatorCount(), "")),
                           static_cast<int>(seen.size())});
    if (series.empty()) return out;
    out.tips = series;
    out.sources.push_back({"recorded series", io::sha256Of(procedures::tipSeriesCsv(series, "")),
                           static_cast<int>(series.history.rows())});
    if (left_out > 0) {
      out.warnings.push_back("the series of the tip has no room for its last " +
                             std::to_string(left_out) + " rows; expected a run of fewer steps");
    }
    return out;
  }

  /// A data set of tag corners, as CSV.
  std::string table() const {
    return io::tagCornerCsv(numbered(samples, scene.arm), scene.arm.actuatorCount(),
                            kRecordedTitle + scene.name + ", " + procedures::utcNow());
  }

  /// A data set of the series, as CSV; its times are those of the table.
  std::string seriesTable() const {
    return procedures::tipSeriesCsv(series,
                                    kRecordedTitle + scene.name + ", " + procedures::utcNow());
  }
};

/// Listens to what is measured of an arm, tells whether it stands still and whether measurements
/// are fresh, and holds the samples. From any thread.
///
/// Ages and windows go by the stamps of messages and ROS time; where ROS time stands still, by a
/// steady clock (MovingClock).
class Recorder {
 public:
  /// The arm at one moment.
  struct Observation {
    double time;       ///< ROS time, or the steady clock that goes on where it stands still [s]
    bool time_stands;  ///< ROS time stands still
    procedures::Settling settling;
  };

  /// @param scene  All actuators are driven by pressure.
  /// @throws std::invalid_argument naming what breaks a rule.
  Recorder(ros::NodeHandle& node, io::Scene scene, const procedures::SettleRules& rules)
      : scene_(std::move(scene)),
        watch_(actuatorNames(scene_.arm), rules),
        detections_subscriber_(
            listen(node, names::kTagDetections, 100, &Recorder::onDetections, this)),
        measured_subscriber_(
            listen(node, names::kPressureMeasured, 100, &Recorder::onMeasured, this)),
        command_subscriber_(listen(node, names::kPressureCommand, 100, &Recorder::onCommand, this)),
        shape_subscriber_(listen(node, names::kMeasured, 100, &Recorder::onShape, this)),
        vision_subscriber_(listen(node, names::kVisionStatus, 100, &Recorder::onVision, this)),
        watch_timer_(repeat(node, "the watch", kWatchPeriod, &Recorder::onWatch, this)) {}
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  Observation observe() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    const double now = clock_.now();
    return {now, clock_.stands(), settlingAt(now)};
  }

  /// Adds the median of the pictures of the window.
  /// @return what was added.
  /// @throws std::invalid_argument where the arm does not stand still or is not measured, and where
  /// the last sample is of these pictures.
  procedures::Sample record() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    const procedures::Settling state = settlingAt(clock_.now());
    basics::require(state.settled(), "not recorded: ", state.reason);
    const std::vector<procedures::Sample> pictures = watch_.samples();
    const bool again = !samples_.empty() && pictures.front().time <= samples_.back().time &&
                       samples_.back().time <= pictures.back().time;
    basics::require(!again, "not recorded: the last sample is of these pictures; wait for ",
                    watch_.rules().window, " s (~window_s)");
    samples_.push_back(medianOf(pictures));
    return samples_.back();
  }
  void add(procedures::Sample sample) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    samples_.push_back(std::move(sample));
  }
  /// of the samples
  std::size_t count() const HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    return samples_.size();
  }
  /// Text of the scene that was calibrated last.
  void keep(const std::string& calibrated) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    calibrated_ = calibrated;
  }
  /// Forgets samples, series and calibrated scene.
  /// @return how many samples there were.
  std::size_t clear() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    const std::size_t out = samples_.size();
    samples_.clear();
    series_.reset();
    calibrated_.reset();
    records_series_ = false;
    return out;
  }
  /// Records a series of pressures and tips, until it is stopped; forgets the one before.
  void startSeries() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    series_.emplace(scene_.arm.actuatorCount());
    records_series_ = true;
  }
  void stopSeries() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    records_series_ = false;
  }

  io::Scene scene() const HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    return scene_;
  }
  Recording recording() const HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    Recording out{scene_, samples_, {}, 0, calibrated_};
    if (series_) {
      out.series = series_->series();
      out.left_out = series_->leftOut();
    }
    return out;
  }

  /// Replaces the scene; the samples stay, the calibrated one does not.
  /// @throws std::invalid_argument where it is not pneumatic or of another rig; nothing changes.
  void adopt(io::Scene next) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    next = requirePneumatic(std::move(next));
    requireSameRig(scene_, next);
    scene_ = std::move(next);
    calibrated_.reset();
  }

 private:
  // Callbacks of the spinning thread.
  void onDetections(const TagDetectionsConstPtr& detections) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    watch_.seen(detections->header.stamp.toSec(), observationsOf(*detections, scene_));
  }
  void onMeasured(const PressureArrayConstPtr& measured) HELIX_ARM_EXCLUDES(mutex_) {
    take(*measured, names::kPressureMeasured, &procedures::SettleWatch::measured);
  }
  void onCommand(const PressureArrayConstPtr& command) HELIX_ARM_EXCLUDES(mutex_) {
    take(*command, names::kPressureCommand, &procedures::SettleWatch::command);
  }
  void onShape(const ArmShapeConstPtr& shape) HELIX_ARM_EXCLUDES(mutex_) {
    const geometry_msgs::Point& tip = shape->tip.position;
    const auto checked = control::checkPosition({tip.x, tip.y, tip.z});
    const auto* position = std::get_if<Eigen::Vector3d>(&checked);
    const basics::MutexLock lock(mutex_);
    if (records_series_ && position) series_->seen(shape->header.stamp.toSec(), *position);
  }
  void onVision(const VisionStatusConstPtr& status) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    vision_ = *status;
  }
  void onWatch(const ros::SteadyTimerEvent&) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    clock_.now();
  }

  static constexpr double kWatchPeriod = 0.1;  // [s]

  static std::vector<std::string> actuatorNames(const model::Arm& arm) {
    std::vector<std::string> out;
    for (int i = 0; i < arm.actuatorCount(); ++i) out.push_back(arm.actuator(i).name);
    return out;
  }

  using Input = void (procedures::SettleWatch::*)(double time, const Eigen::VectorXd& pressure);
  /// Hands a message's pressures to the watch; warns where they are not of the scene.
  void take(const PressureArray& message, const char* topic, Input input)
      HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    const auto checked = control::checkReading(scene_.arm, message.name, message.pressure);
    if (const auto* pressure = std::get_if<Eigen::VectorXd>(&checked)) {
      const double time = message.header.stamp.toSec();
      (watch_.*input)(time, *pressure);
      const bool reading = input == &procedures::SettleWatch::measured;
      if (records_series_ && reading) series_->measured(time, *pressure);
    } else if (foreign_pressures_.add()) {
      logWarning("%s does not match scene %s: %s (%lu times so far)", topic, scene_.name.c_str(),
                 std::get<control::Refusal>(checked).message.c_str(), foreign_pressures_.total());
    }
  }
  procedures::Settling settlingAt(double now) const HELIX_ARM_REQUIRES(mutex_) {
    procedures::Settling out = watch_.at(now);
    // If no tags are seen, vision_status knows the cause.
    const bool blind = out.stale() || out.state == procedures::SettleState::kNoTags;
    if (blind && vision_ && vision_->state != VisionStatus::MEASURED) {
      out.reason += "; vision says: " + basics::quoted(vision_->message, kLongestMessage);
    }
    return out;
  }

  mutable basics::Mutex mutex_;
  io::Scene scene_ HELIX_ARM_GUARDED_BY(mutex_);
  MovingClock clock_ HELIX_ARM_GUARDED_BY(mutex_);
  procedures::SettleWatch watch_ HELIX_ARM_GUARDED_BY(mutex_);
  std::optional<VisionStatus> vision_ HELIX_ARM_GUARDED_BY(mutex_);  ///< the last one
  FaultCount foreign_pressures_ HELIX_ARM_GUARDED_BY(mutex_);
  std::vector<procedures::Sample> samples_ HELIX_ARM_GUARDED_BY(mutex_);
  std::optional<std::string> calibrated_ HELIX_ARM_GUARDED_BY(mutex_);

  std::optional<procedures::SeriesRecord> series_ HELIX_ARM_GUARDED_BY(mutex_);
  bool records_series_ HELIX_ARM_GUARDED_BY(mutex_) = false;

  ros::Subscriber detections_subscriber_, measured_subscriber_, command_subscriber_;
  ros::Subscriber shape_subscriber_, vision_subscriber_;
  ros::SteadyTimer watch_timer_;
};

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

constexpr double kUndetermined = std::numeric_limits<double>::quiet_NaN();

/// Fills the response of the service or the result of the action.
/// @param path  Of the calibrated scene.
template <class Answer>
void fill(Answer& out, const procedures::CalibrationOutcome& outcome, const std::string& path) {
  out.success = outcome.success;
  out.message = outcome.message;
  out.warnings = outcome.warnings;
  out.held_out_error = kUndetermined;
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
  if (outcome.mode) {
    out.rms = outcome.mode->fit.rms;
    out.error_unit = "m";
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

// The jobs of JobSlot, as another one is refused.
constexpr char kRun[] = "run_calibration is running; wait for it, or cancel it first";
constexpr char kFit[] = "a fit is running; wait for it";

/// The one long job that the calibration node does at a time: a run of its action, or the fit of a
/// service. While a job holds the slot, no other starts, and neither samples nor scene are changed
/// from outside. From any thread.
///
/// Its mutex is locked after that of ReloadServer, and before that of Recorder.
class JobSlot {
 public:
  /// Holds the slot until its last copy ends.
  using Claim = std::shared_ptr<void>;

  /// @throws std::invalid_argument naming the job that is under way.
  Claim claim(const char* job) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    basics::require(job_ == nullptr, job_);
    job_ = job;
    return Claim(nullptr, [this](void*) {
      const basics::MutexLock end(mutex_);
      job_ = nullptr;
    });
  }

  bool runs() const HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    return job_ == kRun;
  }

  /// Runs a short body; no job starts meanwhile.
  /// @return what the body returns.
  /// @throws std::invalid_argument naming the job that is under way, and what the body throws.
  template <class Body>
  auto whileIdle(const Body& body) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    basics::require(job_ == nullptr, job_);
    return body();
  }

 private:
  mutable basics::Mutex mutex_;
  const char* job_ HELIX_ARM_GUARDED_BY(mutex_) = nullptr;
};

/// Reads data sets, fits the file of the node's scene, and writes the calibrated scene, which the
/// recorder keeps. From any thread; no file is read or written and nothing is fitted under a lock.
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
             const procedures::SettleRules& rules, Recorder& recorder, SceneFile scene_file)
      : data_access_({{data_folder, "~data_folder"}, {out_folder, "~out_folder"}}),
        out_access_({{out_folder, "~out_folder"}}),
        rules_(rules),
        recorder_(recorder),
        scene_file_(std::move(scene_file)) {
    for (const std::string& folder : {data_folder, out_folder}) {
      std::error_code fault;
      std::filesystem::create_directories(folder, fault);
      if (!fault) continue;
      logWarning(
          "the folder %s does not exist and cannot be created (%s): services cannot use files in "
          "it",
          folder.c_str(), fault.message().c_str());
    }
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
  procedures::CalibrationData load(const std::vector<std::string>& paths) const {
    std::vector<std::string> allowed;
    for (const std::string& path : paths) {
      allowed.push_back(data_access_.toRead("data", path, {".csv", ".bag"}));
    }
    return loadMeasurements(recorder_.scene(), allowed, rules_);
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
                                           const std::function<bool()>& cancelled) {
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
    recorder_.keep(outcome.scene_text);
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

 private:
  const FileAccess data_access_, out_access_;
  const procedures::SettleRules rules_;
  Recorder& recorder_;
  const SceneFile scene_file_;
};

constexpr double kFeedbackPeriod = 0.2;  // [s]
constexpr int kUsualCaptures = 3;        // per pressure
constexpr std::chrono::milliseconds kBetweenLooks(5);

/// Serves the action ~run_calibration in a thread of its own: forgets what was recorded, steps the
/// arm through a plan of pressures and records it at each, ramps down, asks pressure_command to
/// rest, if the arm follows it and no other goal waits, and calibrates. Where the node that sent
/// the goal is gone, it ramps down at once.
///
/// Publishes pressure_target during a run alone. Its mutex is locked before that of Recorder.
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
  /// In the spinning thread.
  void onStatus(const TargetStatusConstPtr& status) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    trace_.answered(*status);
    if (!motion_ || status->commander != ros::this_node::getName() ||
        status->outcome != TargetStatus::DROPPED) {
      return;
    }
    const std::string message = basics::quoted(status->message, kLongestMessage);
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
    refused.held_out_error = kUndetermined;
    answer(names::kRunCalibration, refused, [&] {
      claim = jobs_.claim(kRun);
      begin(goal);
      refused.success = true;
      refused.message = "begins";
    });
    if (!refused.success) {
      claim.reset();
      return end(refused, false);
    }
    const auto live = [&] {
      client_.watchNext(goal);
      client_.beginNext();
      play();
      client_.release();
      recorder_.stopSeries();
      if (!ros::ok()) return;
      rest();
      conclude(goal);
    };
    if (!goal_guard_.run("", live, &refused.message) && server_->isActive()) {
      refused.success = false;
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
  }

  /// Moves the arm until the run has ended, or ROS is shut down.
  void play() {
    const auto period = std::chrono::duration_cast<std::chrono::steady_clock::duration>(
        std::chrono::duration<double>(1.0 / rate_));
    std::vector<procedures::Sample> captures;  // of this step
    auto due = std::chrono::steady_clock::now(), told = due - std::chrono::hours(1);
    while (ros::ok()) {
      const auto feedback = turn(captures);
      if (!feedback) return;
      const auto now = std::chrono::steady_clock::now();
      if (std::chrono::duration<double>(now - told).count() > kFeedbackPeriod) {
        told = now;
        server_->publishFeedback(*feedback);
      }
      due = std::max(due + period, now);
      std::this_thread::sleep_until(due);
    }
  }

  /// @param captures  Of this step so far; goes on.
  /// @return nothing if the run has ended, so that nothing was commanded.
  std::optional<RunCalibrationFeedback> turn(std::vector<procedures::Sample>& captures)
      HELIX_ARM_EXCLUDES(mutex_) {
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
    if (run.ended()) return std::nullopt;
    const procedures::CalibrationRun::Order order = run.advance(now, state);
    std_msgs::Header header = toHeaderMsg(ros::Time::now());
    target_publisher_.publish(toPressureMsg(header, motion_->arm, order.pressure));
    trace_.sent(header.stamp);
    if (order.capture) captures.push_back(*order.capture);
    if (order.step_done) {
      recorder_.add(medianOf(captures));
      captures.clear();
    }
    RunCalibrationFeedback out;
    out.step = static_cast<std::uint32_t>(run.step() + 1);
    out.steps = static_cast<std::uint32_t>(run.steps());
    out.state = nameOf(run.phase());
    const bool waits = run.waitsForPictures();
    if (waits || (run.phase() == procedures::RunPhase::kSettling && !state.settled())) {
      out.state += ": " + state.reason;
    }
    if (waits && !motion_->waited) {
      logWarning("run_calibration waits for pictures, at most %g s (~patience_s): %s",
                 rules_.patience, state.reason.c_str());
    }
    motion_->waited = waits;
    out.pressure.assign(order.pressure.begin(), order.pressure.end());
    out.samples = static_cast<std::uint32_t>(recorder_.count());
    return out;
  }

  /// Brings the arm to rest after a run, if it is still the run's and no other goal waits for it.
  void rest() HELIX_ARM_EXCLUDES(mutex_) {
    for (bool waits = true; waits; std::this_thread::sleep_for(kBetweenLooks)) {
      // Without a master, the call would block.
      if (EndRequest::isUrgent() || !ros::ok()) return;
      const basics::MutexLock lock(mutex_);
      if (server_->isNewGoalAvailable()) return;
      waits = trace_.awaitsAnswer();
      if (!waits && !trace_.commands() && !trace_.wasRested()) return;
    }
    requestRest();
  }

  /// Calibrates where the run was completed, and sets the result.
  void conclude(const RunCalibrationGoal& goal) HELIX_ARM_EXCLUDES(mutex_) {
    RunCalibrationResult result;
    result.held_out_error = kUndetermined;
    RunCalibrationFeedback feedback;
    feedback.state = "fitting";
    basics::MutexLock lock(mutex_);
    const procedures::RunEnd verdict = motion_->run.verdict();
    result.message = motion_->run.reason();
    feedback.step = feedback.steps = static_cast<std::uint32_t>(motion_->run.steps());
    lock.unlock();
    if (verdict != procedures::RunEnd::kCompleted) {
      logWarning("run_calibration: %s", result.message.c_str());
      return end(result, verdict == procedures::RunEnd::kPreempted);
    }
    answer(names::kRunCalibration, result, [&] {
      const Recording recording = recorder_.recording();
      const procedures::CalibrationData data = recording.data();
      feedback.samples = static_cast<std::uint32_t>(recording.samples.size());
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
  double rate = reader.number("rate", 50.0, {5, 1000});  ///< of targets in run_calibration [Hz]
  std::string scene_folder = reader.folder("scene_folder", defaultFolder());
  /// Below which data sets are read (of either), and scenes and samples are written (of the
  /// second); made where they are missing.
  std::string data_folder = reader.folder("data_folder", defaultFolder());
  std::string out_folder = reader.folder("out_folder", defaultFolder());

  CalibrationNodeOptions() {
    settle.pressure_tolerance = 1e3 * reader.number("pressure_tolerance_kpa",
                                                    1e-3 * settle.pressure_tolerance, {0.01, 100});
    settle.corner_tolerance =
        reader.number("corner_tolerance_px", settle.corner_tolerance, {0.01, 100});
    settle.window = reader.number("window_s", settle.window, {0.05, 60});
    settle.max_age = reader.number("max_age_s", settle.max_age, {0.05, 60});
    run.ramp = 1e3 * reader.number("ramp_kpa_s", 1e-3 * run.ramp, {0.1, 10000});
    run.patience = reader.number("patience_s", run.patience, {0.1, 3600});
    reader.finish();
  }
};

/// Records the arm where it stands still, and calibrates the scene with what was recorded or with
/// data sets: the node calibration of docs/nodes.md.
///
/// Preempted, without fresh measurements, where the arm does not settle, and when the node is to
/// end, ~run_calibration ramps down and ends without a calibration; what was recorded stays. When
/// another commander has the arm, it ends and leaves the arm to it. Ages and windows go by the
/// stamps of messages and ROS time, so that simulated time may run fast. Where ROS time stands
/// still the run ends, and ramps down by a steady clock.
///
/// Messages, services and ~reload are handled in the spinning thread, run_calibration in a thread
/// of its own. Locks in their order: ReloadServer, JobSlot or RunAction, Recorder.
class CalibrationNode : public Node {
 public:
  CalibrationNode()
      : recorder_(node_, requirePneumatic(io::loadScene(options_.scene)), options_.settle),
        calibrator_(options_.data_folder, options_.out_folder, options_.settle, recorder_,
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
    response.held_out_error = kUndetermined;
    return answer(names::kCalibrate, response, [&] {
      const std::string out = calibrator_.scenePath(request.out);
      const JobSlot::Claim fit = jobs_.claim(kFit);
      const procedures::CalibrationData data =
          request.data.empty() ? recorder_.recording().data() : calibrator_.load(request.data);
      fill(response, calibrator_.calibrate(requestOf(request), data, out, neverCancelled), out);
    });
  }

  bool onFitContraction(FitContraction::Request& request, FitContraction::Response& response) {
    response.hysteresis = kUndetermined;
    return answer(names::kFitContraction, response, [&] {
      const procedures::CalibrationRequest job = requestOf(request);
      const std::string path = calibrator_.tablePath(request.data);
      const std::string out = calibrator_.scenePath(request.out);
      const JobSlot::Claim fit = jobs_.claim(kFit);
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
      response.cleared =
          static_cast<std::uint32_t>(jobs_.whileIdle([&] { return recorder_.clear(); }));
      response.success = true;
      response.message = std::to_string(response.cleared) + " samples cleared";
    });
  }

  bool onSave(Save::Request& request, Save::Response& response) {
    return answer(names::kSave, response, [&] {
      const std::string path = calibrator_.savePath(request.path);
      const Recording recording = jobs_.whileIdle([&] { return recorder_.recording(); });
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
        basics::require(recording.calibrated.has_value(),
                        "nothing was calibrated; call calibrate first");
        text = *recording.calibrated;
        response.message = "the last calibration of " + recording.scene.name + " in " + path;
      }
      io::writeFileAtomically(path, text);
      response.success = true;
    });
  }

  void adopt(io::Scene next) {
    jobs_.whileIdle([&] { recorder_.adopt(std::move(next)); });
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
