#include "helix_arm/ros_bridge/calibration/calibration_node.hpp"

#include <chrono>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>
#include <stdexcept>
#include <thread>
#include <utility>

#include <ros/console.h>
#include <ros/this_node.h>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/content_hash.hpp"
#include "helix_arm/procedures/captures.hpp"
#include "helix_arm/procedures/pressure_plan.hpp"
#include "helix_arm/ros_bridge/calibration/bag_captures.hpp"
#include "helix_arm/ros_bridge/common/clock_gate.hpp"
#include "helix_arm/ros_bridge/common/conversions.hpp"
#include "helix_arm/ros_bridge/common/file_access.hpp"
#include "helix_arm/ros_bridge/common/guarded_callbacks.hpp"
#include "helix_arm/ros_bridge/common/names.hpp"
#include "helix_arm/ros_bridge/common/parameters.hpp"
#include "helix_arm/ros_bridge/common/pneumatics.hpp"

namespace ros::serialization {

// actionlib subscribes by itself. Goals and cancellations with a stamp that it could not count
// with, in callbacks where nobody catches, are not read at all.
template <>
struct Serializer<actionlib_msgs::GoalID> {
  using GoalID = actionlib_msgs::GoalID;
  template <class Stream>
  static void read(Stream& stream, GoalID& goal) {
    stream.next(goal.stamp);
    stream.next(goal.id);
    if (helix_arm::ros_bridge::ClockGate::isSound(goal.stamp)) return;
    throw std::runtime_error("its stamp is " + std::to_string(goal.stamp.sec) + " s and " +
                             std::to_string(goal.stamp.nsec) + " ns; expected less than 2^31 s");
  }
  template <class Stream>
  static void write(Stream& stream, const GoalID& goal) {
    stream.next(goal.stamp);
    stream.next(goal.id);
  }
  static std::uint32_t serializedLength(const GoalID& goal) {
    return serializationLength(goal.stamp) + serializationLength(goal.id);
  }
};

// And goals are read as all other messages are, see CheckedStream.
template <>
struct Serializer<helix_arm::RunCalibrationActionGoal> {
  using Goal = helix_arm::RunCalibrationActionGoal;
  template <class Stream>
  static void read(Stream& stream, Goal& goal) {
    helix_arm::ros_bridge::CheckedStream checked(stream.getData(), stream.getLength());
    checked.next(goal.header);
    checked.next(goal.goal_id);
    checked.next(goal.goal);
    stream.advance(stream.getLength() - static_cast<std::uint32_t>(checked.left()));
  }
  template <class Stream>
  static void write(Stream& stream, const Goal& goal) {
    stream.next(goal.header);
    stream.next(goal.goal_id);
    stream.next(goal.goal);
  }
  static std::uint32_t serializedLength(const Goal& goal) {
    return serializationLength(goal.header) + serializationLength(goal.goal_id) +
           serializationLength(goal.goal);
  }
};

}  // namespace ros::serialization

namespace helix_arm::ros_bridge {
namespace {

constexpr double kWatchPeriod = 0.1;           // [s]
constexpr double kFeedbackPeriod = 0.2;        // [s]
constexpr int kUsualCaptures = 3;              // a pressure
constexpr std::size_t kLongestMessage = 1000;  // of another node
constexpr char kRecorded[] = "recorded samples";

std::vector<std::string> actuatorNames(const model::Arm& arm) {
  std::vector<std::string> out;
  for (int i = 0; i < arm.actuatorCount(); ++i) out.push_back(arm.actuator(i).name);
  return out;
}

void makeFolder(const std::string& folder) {
  std::error_code fault;
  std::filesystem::create_directories(folder, fault);
  if (fault) {
    ROS_WARN("the folder %s is not there and cannot be made (%s): services find no files in it",
             folder.c_str(), fault.message().c_str());
  }
}

// Runs what answers a service: what it throws is the answer.
template <class Response, class Body>
bool answer(const char* service, Response& response, const Body& body) {
  try {
    body();
  } catch (const std::exception& fault) {
    response.success = false;
    response.message = fault.what();
  }
  if (response.success) {
    ROS_INFO("%s: %s", service, response.message.c_str());
  } else {
    ROS_WARN("%s: %s", service, response.message.c_str());
  }
  return true;
}

// Into the response of the service or the result of the action.
template <class Answer>
void fill(Answer& out, const procedures::CalibrationOutcome& outcome, const std::string& path) {
  out.success = outcome.success;
  out.message = outcome.message;
  out.warnings = outcome.warnings;
  out.held_out_error = std::numeric_limits<double>::quiet_NaN();
  if (outcome.success) out.out = path;
  if (!outcome.calibration) return;
  const estimation::Calibration& calibration = *outcome.calibration;
  for (const estimation::Parameter& parameter : calibration.parameters) {
    out.names.push_back(parameter.name);
    out.units.push_back(parameter.unit);
    out.initial.push_back(parameter.initial);
    out.values.push_back(parameter.value);
    out.standard_errors.push_back(parameter.standard_error);
    out.identifiable.push_back(parameter.identifiable);
  }
  out.rms = calibration.rms;
  out.error_unit = calibration.error_unit;
  if (calibration.by_pressure) out.held_out_error = calibration.by_pressure->error;
  for (const Eigen::VectorXd& row : calibration.next_pressures) {
    out.next_pressures.insert(out.next_pressures.end(), row.begin(), row.end());
  }
}

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

}  // namespace

CalibrationNodeOptions CalibrationNodeOptions::load() {
  ParameterReader reader{ros::NodeHandle("~")};
  CalibrationNodeOptions out;
  procedures::SettleRules& settle = out.settle;
  out.scene = reader.file("scene", "config/scenes", ".yaml");
  settle.pressure_tolerance =
      1e3 * reader.number("pressure_tolerance_kpa", 1e-3 * settle.pressure_tolerance, {0.01, 100});
  settle.corner_tolerance =
      reader.number("corner_tolerance_px", settle.corner_tolerance, {0.01, 100});
  settle.window = reader.number("window_s", settle.window, {0.05, 60});
  settle.max_age = reader.number("max_age_s", settle.max_age, {0.05, 60});
  out.run.ramp = 1e3 * reader.number("ramp_kpa_s", 1e-3 * out.run.ramp, {0.1, 10000});
  out.run.patience = reader.number("patience_s", out.run.patience, {0.1, 3600});
  out.rate = reader.number("rate", out.rate, {5, 1000});
  out.scene_folder = reader.folder("scene_folder", defaultFolder());
  out.data_folder = reader.folder("data_folder", defaultFolder());
  out.out_folder = reader.folder("out_folder", defaultFolder());
  reader.finish();
  return out;
}

CalibrationNode::CalibrationNode()
    : options_(CalibrationNodeOptions::load()),
      scene_(requirePneumatic(io::loadScene(options_.scene))),
      data_access_({{options_.data_folder, "~data_folder"}, {options_.out_folder, "~out_folder"}}),
      out_access_({{options_.out_folder, "~out_folder"}}),
      watch_(actuatorNames(scene_.arm), options_.settle) {
  makeFolder(options_.data_folder);
  makeFolder(options_.out_folder);
  target_publisher_ = node_.advertise<PressureArray>(names::kPressureTarget, 10);
  using Node = CalibrationNode;
  detections_subscriber_ = listen(node_, names::kTagDetections, 100, &Node::onDetections, this);
  measured_subscriber_ = listen(node_, names::kPressureMeasured, 100, &Node::onMeasured, this);
  command_subscriber_ = listen(node_, names::kPressureCommand, 100, &Node::onCommand, this);
  status_subscriber_ = listen(node_, names::kTargetStatus, 100, &Node::onStatus, this);
  vision_subscriber_ = listen(node_, names::kVisionStatus, 100, &Node::onVision, this);

  ros::NodeHandle mine("~");
  calibrate_ = serve(mine, names::kCalibrate, &Node::onCalibrate, this);
  fit_contraction_ = serve(mine, names::kFitContraction, &Node::onFitContraction, this);
  record_ = serve(mine, names::kRecordSample, &Node::onRecord, this);
  clear_ = serve(mine, names::kClearSamples, &Node::onClear, this);
  save_ = serve(mine, names::kSave, &Node::onSave, this);
  reload_ = std::make_unique<ReloadServer>(mine, options_.scene, options_.scene_folder,
                                           [this](io::Scene next) { adopt(std::move(next)); });
  watch_timer_ = repeat(node_, "the watch", kWatchPeriod, &Node::onWatch, this);
  server_ = std::make_unique<Server>(
      mine, names::kRunCalibration,
      [this](const RunCalibrationGoalConstPtr& goal) {
        goal_guard_.run("", [&] { onGoal(*goal); });
      },
      false);
  server_->start();
  ROS_INFO("%s: %s", scene_.name.c_str(),
           scene_.camera && scene_.tags
               ? "ready to record and to calibrate"
               : "ready to calibrate from data sets; its scene lacks `camera` or `tags`, so "
                 "nothing can be recorded");
}

CalibrationNode::~CalibrationNode() = default;

void CalibrationNode::onDetections(const TagDetectionsConstPtr& detections) {
  const std::lock_guard<std::mutex> lock(mutex_);
  watch_.seen(detections->header.stamp.toSec(), sightingsOf(*detections, scene_));
}

std::optional<Eigen::VectorXd> CalibrationNode::reading(const PressureArray& message,
                                                        const char* topic) {
  const auto checked = control::checkReading(scene_.arm, message.name, message.pressure);
  if (const auto* pressure = std::get_if<Eigen::VectorXd>(&checked)) return *pressure;
  if (foreign_pressures_.add()) {
    ROS_WARN("%s is not of scene %s: %s (%lu times so far)", topic, scene_.name.c_str(),
             std::get<control::Refusal>(checked).message.c_str(),
             static_cast<unsigned long>(foreign_pressures_.total()));
  }
  return std::nullopt;
}

void CalibrationNode::onMeasured(const PressureArrayConstPtr& measured) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (const auto pressure = reading(*measured, names::kPressureMeasured)) {
    watch_.measured(measured->header.stamp.toSec(), *pressure);
  }
}

void CalibrationNode::onCommand(const PressureArrayConstPtr& command) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (const auto pressure = reading(*command, names::kPressureCommand)) {
    watch_.command(command->header.stamp.toSec(), *pressure);
  }
}

void CalibrationNode::onStatus(const TargetStatusConstPtr& status) {
  if (status->commander != ros::this_node::getName() || status->outcome != TargetStatus::DROPPED) {
    return;
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!run_) return;
  const std::string message = basics::quoted(status->message, kLongestMessage);
  if (status->fault == control::nameOf(control::Fault::kOtherCommander)) {
    run_->yield(message);
  } else if (status->fault == control::nameOf(control::Fault::kStale)) {
    // The next one may be in time; where none is, the arm vents, and that ends the run.
    ROS_WARN_THROTTLE(1, "%s", message.c_str());
  } else {
    run_->end(procedures::RunEnd::kAborted, "pressure_command refused a target: " + message);
  }
}

void CalibrationNode::onVision(const VisionStatusConstPtr& status) {
  const std::lock_guard<std::mutex> lock(mutex_);
  vision_ = *status;
}

void CalibrationNode::onWatch(const ros::SteadyTimerEvent&) {
  const std::lock_guard<std::mutex> lock(mutex_);
  clock_.now();
}

bool CalibrationNode::isBusy() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return running_;
}

void CalibrationNode::requireIdle() const {
  basics::require(!running_, "run_calibration is under way; wait for it, or cancel it first");
  basics::require(!fitting_, "a fit is under way; wait for it");
}

procedures::Settling CalibrationNode::settling(double now) const {
  procedures::Settling out = watch_.at(now);
  // Vision knows better why.
  const bool blind = out.stale() || out.state == procedures::SettleState::kNoTags;
  if (blind && vision_ && vision_->state != VisionStatus::MEASURED) {
    out.reason += "; vision says: " + basics::quoted(vision_->message, kLongestMessage);
  }
  return out;
}

bool CalibrationNode::onRecord(RecordSample::Request&, RecordSample::Response& response) {
  return answer(names::kRecordSample, response, [&] {
    const std::lock_guard<std::mutex> lock(mutex_);
    response.samples = static_cast<std::uint32_t>(samples_.size());
    requireIdle();
    const procedures::Settling state = settling(clock_.now());
    basics::require(state.settled(), "not recorded: ", state.reason);
    const std::vector<procedures::Sample> pictures = watch_.samples();
    const bool again = !samples_.empty() && pictures.front().time <= samples_.back().time &&
                       samples_.back().time <= pictures.back().time;
    basics::require(!again, "not recorded: the last sample is of these pictures; wait for ",
                    options_.settle.window, " s (~window_s)");
    samples_.push_back(medianOf(pictures));
    const procedures::Sample& sample = samples_.back();
    response.samples = static_cast<std::uint32_t>(samples_.size());
    response.tags = static_cast<std::uint32_t>(sample.tags.size());
    response.pressure.assign(sample.pressure.begin(), sample.pressure.end());
    response.success = true;
    response.message = "sample " + std::to_string(samples_.size()) + " with " +
                       std::to_string(sample.tags.size()) + " tags";
  });
}

bool CalibrationNode::onClear(ClearSamples::Request&, ClearSamples::Response& response) {
  return answer(names::kClearSamples, response, [&] {
    const std::lock_guard<std::mutex> lock(mutex_);
    requireIdle();
    response.cleared = static_cast<std::uint32_t>(samples_.size());
    samples_.clear();
    last_.reset();
    response.success = true;
    response.message = std::to_string(response.cleared) + " samples forgotten";
  });
}

bool CalibrationNode::onSave(Save::Request& request, Save::Response& response) {
  return answer(names::kSave, response, [&] {
    // The last calibration, or what was recorded.
    const std::string path = out_access_.toWrite("path", request.path, {".yaml", ".csv"});
    const bool table = std::filesystem::path(path).extension() == ".csv";
    std::string text;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      requireIdle();
      if (table) {
        basics::require(!samples_.empty(), "nothing was recorded; call record_sample first");
        text = io::tagCornerCsv(numbered(samples_, scene_.arm), scene_.arm.actuatorCount(),
                                kRecordedTitle + scene_.name + ", " + procedures::utcNow());
        response.message = std::to_string(samples_.size()) + " samples in " + path;
      } else {
        basics::require(last_.has_value(), "nothing was calibrated; call calibrate first");
        text = last_->scene_text;
        response.message = "the last calibration of " + scene_.name + " in " + path;
      }
    }
    io::writeFileAtomically(path, text);
    response.success = true;
  });
}

void CalibrationNode::adopt(io::Scene next) {
  const std::lock_guard<std::mutex> lock(mutex_);
  requireIdle();
  next = requirePneumatic(std::move(next));
  requireSameRig(scene_, next);
  scene_ = std::move(next);
  last_.reset();
}

procedures::CalibrationData CalibrationNode::recorded() const {
  const std::vector<io::TagCornerCapture> seen = numbered(samples_, scene_.arm);
  basics::require(!seen.empty(),
                  "nothing was recorded; call record_sample or run_calibration first, or name data "
                  "sets");
  procedures::CalibrationData out;
  out.captures = procedures::makeCaptures(scene_, seen, kRecorded).captures;
  out.sources.push_back({kRecorded,
                         io::sha256Of(io::tagCornerCsv(seen, scene_.arm.actuatorCount(), "")),
                         static_cast<int>(seen.size())});
  return out;
}

std::string CalibrationNode::writable(const std::string& out) const {
  return out.empty() ? out : out_access_.toWrite("out", out, {".yaml"});
}

procedures::CalibrationData CalibrationNode::load(const std::vector<std::string>& paths) const {
  std::vector<std::string> allowed;
  for (const std::string& path : paths) {
    allowed.push_back(data_access_.toRead("data", path, {".csv", ".bag"}));
  }
  return loadMeasurements(scene_, allowed, options_.settle);
}

procedures::CalibrationOutcome CalibrationNode::calibrate(
    const procedures::CalibrationRequest& request, const procedures::CalibrationData& data,
    const std::string& out, const std::function<bool()>& cancelled) {
  const ReloadServer::File file = reload_->file();
  basics::require(io::sha256OfFile(file.path) == file.sha256, file.path,
                  " is not what it was when it was loaded; call reload first");
  procedures::CalibrationOutcome outcome = procedures::runCalibration(file.path, {}, request, data);
  if (!outcome.success) return outcome;
  if (cancelled()) {
    outcome.success = false;
    outcome.message = "it was cancelled";
    return outcome;
  }
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    last_ = outcome;
  }
  if (out.empty()) return outcome;
  try {
    io::writeFileAtomically(writable(out), outcome.scene_text);
  } catch (const std::exception& fault) {
    outcome.success = false;
    outcome.message +=
        ", but it is not written: " + std::string(fault.what()) + "; call save with another path";
  }
  return outcome;
}

bool CalibrationNode::onCalibrate(Calibrate::Request& request, Calibrate::Response& response) {
  response.held_out_error = std::numeric_limits<double>::quiet_NaN();
  return answer(names::kCalibrate, response, [&] {
    const std::string out = writable(request.out);
    procedures::CalibrationData data;
    const Fitting busy(*this);
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      data = request.data.empty() ? recorded() : load(request.data);
    }
    procedures::CalibrationRequest job;
    job.fit = request.fit;
    job.curvature_noise = request.curvature_noise;
    job.corner_noise = request.corner_noise_px;
    job.position_noise = request.position_noise;
    job.rotation_noise = request.rotation_noise;
    job.date = procedures::utcNow();
    fill(response, calibrate(job, data, out, [] { return false; }), out);
  });
}

bool CalibrationNode::onFitContraction(FitContraction::Request& request,
                                       FitContraction::Response& response) {
  using estimation::Branch;
  using estimation::CurveKind;
  response.hysteresis = std::numeric_limits<double>::quiet_NaN();
  return answer(names::kFitContraction, response, [&] {
    procedures::CalibrationRequest job;
    job.fit = {"contraction"};
    job.contraction = request.contraction;
    job.curve.kind = wordOf<CurveKind>(
        "kind", request.kind, {{"quintic", CurveKind::kQuintic}, {"table", CurveKind::kTable}});
    job.curve.branch = wordOf<Branch>(
        "branch", request.branch,
        {{"both", Branch::kBoth}, {"rising", Branch::kRising}, {"falling", Branch::kFalling}});
    job.date = procedures::utcNow();
    const std::string path = data_access_.toRead("data", request.data, {".csv"});
    const std::string out = writable(request.out);
    procedures::CalibrationData data;
    const Fitting busy(*this);
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      data = procedures::loadCalibrationData(scene_, {path});
    }
    basics::require(!data.lengths.empty(), path,
                    " holds no free lengths; expected the columns pressure_kpa and length_m");
    const procedures::CalibrationOutcome outcome = calibrate(job, data, out, [] { return false; });
    response.success = outcome.success;
    response.message = outcome.message;
    if (outcome.success) response.out = out;
    if (outcome.contractions.empty()) return;
    const estimation::ContractionFit& fit = outcome.contractions.front().second;
    if (!fit.curve) return;
    response.rms = fit.rms;
    response.constrained = fit.constrained;
    if (fit.hysteresis) response.hysteresis = *fit.hysteresis;
    if (fit.kind == CurveKind::kQuintic) {
      response.coefficients.assign(fit.coefficients.begin(), fit.coefficients.end());
      response.reference_pressure = fit.reference_pressure;
    } else {
      response.pressures = fit.pressures;
      response.lengths = fit.lengths;
    }
  });
}

void CalibrationNode::onGoal(const RunCalibrationGoal& goal) {
  RunCalibrationResult refused;
  refused.held_out_error = std::numeric_limits<double>::quiet_NaN();
  answer(names::kRunCalibration, refused, [&] {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      requireIdle();
      running_ = true;
    }
    begin(goal);
    refused.success = true;
    refused.message = "begins";
  });
  if (!refused.success) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      running_ = false;
    }
    server_->setAborted(refused, refused.message);
    return;
  }
  std::string why;
  if (!goal_guard_.run(
          "",
          [&] {
            if (play()) conclude(goal);
          },
          &why) &&
      server_->isActive()) {
    refused.success = false;
    server_->setAborted(refused, why);
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  run_.reset();
  running_ = false;
}

void CalibrationNode::begin(const RunCalibrationGoal& goal) {
  // Words that nobody knows throw; that there is no data yet does not.
  procedures::CalibrationRequest request;
  request.fit = goal.fit;
  procedures::runCalibration(reload_->file().path, {}, request, {});
  writable(goal.out);  // what would be found out after a long run only
  procedures::RunRules rules = options_.run;
  rules.captures = goal.captures_per_pressure == 0 ? kUsualCaptures : goal.captures_per_pressure;
  rules.validate();
  basics::require(target_publisher_.getNumSubscribers() > 0,
                  "nobody listens on pressure_target; is pressure_command up?");
  const std::lock_guard<std::mutex> lock(mutex_);
  basics::require(!EndRequest::made(), "the node is about to end");
  basics::require(scene_.camera && scene_.tags, "scene ", scene_.name,
                  " has no `camera` or no `tags`: nothing could be recorded; add them to it");
  const auto plan = procedures::checkPlan(scene_.arm, goal.plan);
  if (const auto* refusal = std::get_if<control::Refusal>(&plan)) {
    throw std::invalid_argument(refusal->message);
  }
  const procedures::Settling state = settling(clock_.now());
  basics::require(!state.stale(), state.reason);
  basics::require(state.set_point.has_value(),
                  "pressure_command has not come yet; is its node up?");
  run_.emplace(std::get<Eigen::MatrixXd>(plan), scene_.arm.clamped(*state.set_point),
               scene_.arm.inputAt(0), rules);
  samples_.clear();
  last_.reset();
}

bool CalibrationNode::play() {
  const auto period = std::chrono::duration_cast<std::chrono::steady_clock::duration>(
      std::chrono::duration<double>(1.0 / options_.rate));
  std::vector<procedures::Sample> captures;  // of this step
  std::chrono::steady_clock::time_point due = std::chrono::steady_clock::now(),
                                        told = due - std::chrono::hours(1);
  std::string last_state;
  while (ros::ok()) {
    RunCalibrationFeedback feedback;
    std_msgs::Header header;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      using procedures::RunEnd;
      const double now = clock_.now();
      if (server_->isPreemptRequested()) run_->end(RunEnd::kPreempted, "it was cancelled");
      if (EndRequest::made()) run_->end(RunEnd::kAborted, "the node is to end");
      if (clock_.stands()) {
        run_->end(RunEnd::kAborted, "ROS time stands still; is the node that gives /clock up?");
      }
      if (run_->ended()) return true;
      const procedures::Settling state = settling(now);
      const procedures::CalibrationRun::Order order = run_->advance(now, state);
      header.stamp = ros::Time::now();
      target_publisher_.publish(toPressureMsg(header, scene_.arm, order.pressure));
      if (order.capture) captures.push_back(*order.capture);
      if (order.step_done) {
        samples_.push_back(medianOf(captures));
        captures.clear();
      }
      feedback.step = static_cast<std::uint32_t>(run_->step() + 1);
      feedback.steps = static_cast<std::uint32_t>(run_->steps());
      feedback.state = nameOf(run_->phase());
      if (run_->phase() == procedures::RunPhase::kSettling && !state.settled()) {
        feedback.state += ": " + state.reason;
      }
      feedback.pressure.assign(order.pressure.begin(), order.pressure.end());
      feedback.samples = static_cast<std::uint32_t>(samples_.size());
    }
    const auto now = std::chrono::steady_clock::now();
    if (std::chrono::duration<double>(now - told).count() > kFeedbackPeriod) {
      told = now;
      server_->publishFeedback(feedback);
    }
    due = std::max(due + period, now);
    std::this_thread::sleep_until(due);
  }
  return false;
}

void CalibrationNode::conclude(const RunCalibrationGoal& goal) {
  RunCalibrationResult result;
  result.held_out_error = std::numeric_limits<double>::quiet_NaN();
  if (run_->verdict() != procedures::RunEnd::kCompleted) {
    result.message = run_->reason();
    ROS_WARN("run_calibration: %s", result.message.c_str());
    if (run_->verdict() == procedures::RunEnd::kPreempted) {
      server_->setPreempted(result, result.message);
    } else {
      server_->setAborted(result, result.message);
    }
    return;
  }
  answer(names::kRunCalibration, result, [&] {
    RunCalibrationFeedback feedback;
    procedures::CalibrationData data;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      feedback.step = feedback.steps = static_cast<std::uint32_t>(run_->steps());
      feedback.samples = static_cast<std::uint32_t>(samples_.size());
      data = recorded();
    }
    feedback.state = "fitting";
    server_->publishFeedback(feedback);
    procedures::CalibrationRequest request;
    request.fit = goal.fit;
    request.date = procedures::utcNow();
    const auto cancelled = [this] { return server_->isPreemptRequested(); };
    const std::string out = writable(goal.out);
    fill(result, calibrate(request, data, out, cancelled), out);
  });
  if (!result.success && server_->isPreemptRequested()) {
    server_->setPreempted(result, result.message);
  } else if (result.success) {
    server_->setSucceeded(result, result.message);
  } else {
    server_->setAborted(result, result.message);
  }
}

}  // namespace helix_arm::ros_bridge
