#include <cmath>
#include <exception>
#include <sstream>

#include <actionlib/client/simple_action_client.h>

#include "helix_arm/FollowTipPathAction.h"
#include "helix_arm/FollowTipPathFeedback.h"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/tip_path_file.hpp"
#include "helix_arm/procedures/calibration_job.hpp"
#include "helix_arm/procedures/report_plot.hpp"
#include "helix_arm/procedures/tip_record.hpp"
#include "nlohmann/json.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/common/goal_serializers.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

using nlohmann::json;
using procedures::RecordedTip;
using procedures::TipRow;

constexpr std::size_t kMostActuators = 100;
constexpr std::size_t kLongestName = 40;  // of an actuator, a frame or a state
constexpr std::size_t kLongestOutcome = 300;
constexpr std::size_t kMostDrawn = 5000;  // rows in a figure

struct Tip {
  RecordedTip tip;
  const char* name;
};

constexpr Tip kTips[] = {{RecordedTip::kModel, "model"},
                         {RecordedTip::kPredicted, "predicted"},
                         {RecordedTip::kMeasured, "measured"}};

// A name without what would end a cell or a line of a table.
std::string plain(const std::string& text, std::size_t longest = kLongestName) {
  std::string out = basics::quoted(text, longest);
  std::replace(out.begin(), out.end(), ',', ';');
  return out;
}

Eigen::Vector3d positionOf(const geometry_msgs::Pose& pose) {
  return {pose.position.x, pose.position.y, pose.position.z};
}

json toJson(const Eigen::VectorXd& vector) {
  return std::vector<double>(vector.data(), vector.data() + vector.size());
}

json runJson(const Tip& tip, const std::vector<const TipRow*>& drawn,
             const std::vector<TipRow>& rows, double end) {
  json times = json::array(), tips = json::array(), errors = json::array();
  for (const TipRow* row : drawn) {
    const auto position = procedures::tipOf(*row, tip.tip);
    if (!position) continue;
    times.push_back(row->path_time);
    tips.push_back(toJson(*position));
    errors.push_back((*position - row->wanted).norm());
  }
  std::string name = tip.name;
  if (const auto error = procedures::errorOf(rows, tip.tip, end)) {
    name += ": RMS " + fixed(1e3 * error->rms, 2) + " mm";
  }
  return {
      {"name", name}, {"kind", tip.name}, {"time_s", times}, {"tip_m", tips}, {"error_m", errors}};
}

json pressuresJson(const std::vector<std::string>& names, const std::vector<const TipRow*>& drawn) {
  json times = json::array(), command = json::array(), measured = json::array();
  for (const TipRow* row : drawn) {
    if (!row->command || !row->pressure) continue;
    times.push_back(row->path_time);
    command.push_back(toJson(*row->command));
    measured.push_back(toJson(*row->pressure));
  }
  if (times.empty()) return nullptr;
  return {{"time_s", times}, {"names", names}, {"command_pa", command}, {"measured_pa", measured}};
}

// What is to be drawn: the path, without the way to it.
std::vector<const TipRow*> drawnRows(const std::vector<TipRow>& rows) {
  std::vector<const TipRow*> all, drawn;
  for (const TipRow& row : rows) {
    if (row.path_time >= 0) all.push_back(&row);
  }
  const std::size_t stride = all.size() / kMostDrawn + 1;
  for (std::size_t k = 0; k < all.size(); k += stride) drawn.push_back(all[k]);
  return drawn;
}

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
  RunRecorder(ros::NodeHandle& node, Files files, std::string path, double end)
      : files_(std::move(files)),
        path_(std::move(path)),
        end_(end),
        model_subscriber_(listen(node, names::kModel, 1000, &RunRecorder::onModel, this)),
        command_subscriber_(
            listen(node, names::kPressureCommand, 1000, &RunRecorder::onCommand, this)),
        measured_subscriber_(
            listen(node, names::kPressureMeasured, 1000, &RunRecorder::onMeasured, this)) {}

  /// Adds a row, unless a number in it is not finite.
  void add(const FollowTipPathFeedback& feedback) {
    // Without a prediction its pose is as empty as a new message's.
    const auto& q = feedback.predicted.orientation;
    const bool predicted = q.x != 0 || q.y != 0 || q.z != 0 || q.w != 0;
    TipRow row{feedback.header.stamp.toSec(),
               feedback.time_from_start.toSec(),
               positionOf(feedback.desired),
               positionOf(feedback.measured),
               predicted ? std::optional(positionOf(feedback.predicted)) : std::nullopt,
               feedback.sd,
               plain(feedback.state)};
    const bool finite = row.wanted.allFinite() && row.measured.allFinite() &&
                        (!predicted || row.predicted->allFinite()) && std::isfinite(row.sd);
    if (!finite) return;
    if (frame_.empty()) frame_ = plain(feedback.header.frame_id);
    record_.add(std::move(row));
  }

  /// Whether all rows have got what other topics say of their times.
  bool isComplete() const { return record_.isComplete(); }

  /// Writes the files. @param outcome  how the goal ended, in a line.
  /// @return why that failed; empty if it did not.
  std::string write(const std::string& outcome) {
    const std::vector<TipRow>& rows = record_.finish();
    if (rows.empty()) {
      return "nothing was recorded: the loop used no picture; look at vision_status and at the "
             "diagnostics of visual_servo";
    }
    if (record_.leftOut() > 0) {
      logWarning("the last %zu pictures are not recorded: a record has at most %zu",
                 record_.leftOut(), procedures::TipRecord::kMostRows);
    }
    const FileAccess access = FileAccess::anywhere();
    try {
      // Checked again: something else may be there by now.
      if (!files_.table.empty()) {
        io::writeFileAtomically(access.toWrite("~record", files_.table, {".csv"}),
                                tableOf(rows, plain(outcome, kLongestOutcome)));
        logInfo("%zu pictures are recorded in %s", rows.size(), files_.table.c_str());
      }
      if (!files_.figure.empty()) {
        const std::string picture = procedures::drawnReport(reportOf(rows), "leave out ~figure");
        io::writeFileAtomically(access.toWrite("~figure", files_.figure, {".png"}), picture);
        logInfo("they are drawn in %s", files_.figure.c_str());
      }
    } catch (const std::exception& fault) {
      return basics::printableLines(fault.what());
    }
    return {};
  }

 private:
  void onModel(const ArmShapeConstPtr& model) {
    const Eigen::Vector3d tip = positionOf(model->tip);
    if (!tip.allFinite()) return;
    record_.model.add(model->header.stamp.toSec(), tip);
    record_.update();
  }

  void onCommand(const PressureArrayConstPtr& command) { add(record_.command, *command); }

  void onMeasured(const PressureArrayConstPtr& measured) { add(record_.pressure, *measured); }

  void add(procedures::TimeSeries& series, const PressureArray& message) {
    const std::size_t count = message.pressure.size();
    const Eigen::VectorXd pressure = Eigen::Map<const Eigen::VectorXd>(
        message.pressure.data(), static_cast<Eigen::Index>(count));
    std::vector<std::string> names;
    for (std::size_t i = 0; i < std::min(count, kMostActuators); ++i) {
      names.push_back(i < message.name.size() ? plain(message.name[i]) : std::to_string(i + 1));
    }
    if (names_.empty()) names_ = names;
    const bool ours =
        count > 0 && count <= kMostActuators && names == names_ && pressure.allFinite();
    if (ours) {
      series.add(message.header.stamp.toSec(), pressure);
      record_.update();
    } else if (foreign_.add()) {
      logWarning(
          "pressures are not recorded (%lu so far): expected finite ones of %zu actuators, in "
          "the order of the first message",
          foreign_.total(), names_.size());
    }
  }

  std::string tableOf(const std::vector<TipRow>& rows, const std::string& outcome) const {
    std::ostringstream out;
    out << "# " << kRecordedRunTitle << plain(path_, kLongestOutcome) << ", "
        << procedures::utcNow() << ": " << outcome
        << "\n# One row per picture that the loop used, at the picture's time. "
        << "Tips seen from " << frame_ << ". time_s: since the start of the path;\n"
        << "# model: by the scene alone; predicted: by the corrected model; command: in force; "
        << "pressure: measured. Actuators:";
    for (const std::string& name : names_) out << " " << name;
    out << ".\n";
    procedures::writeCsv(rows, static_cast<int>(names_.size()), out);
    return out.str();
  }

  std::string reportOf(const std::vector<TipRow>& rows) const {
    std::vector<const TipRow*> drawn = drawnRows(rows);
    if (drawn.empty()) {
      throw std::runtime_error(
          "there is nothing to draw: the tip did not come to the first point of the path");
    }
    json wanted = json::array(), runs = json::array();
    for (const TipRow* row : drawn) wanted.push_back(toJson(row->wanted));
    for (const Tip& tip : kTips) {
      json run = runJson(tip, drawn, rows, end_);
      if (!run["time_s"].empty()) runs.push_back(std::move(run));
    }
    const json follow = {{"wanted_m", wanted},
                         {"along_path", true},
                         {"runs", runs},
                         {"pressures", pressuresJson(names_, drawn)}};
    const std::string name = std::filesystem::path(path_).filename();
    return json{{"scene", basics::quoted(name)}, {"follow", follow}}.dump();
  }

  const Files files_;
  const std::string path_;
  const double end_;
  std::string frame_;               ///< of the tips, by the first feedback
  std::vector<std::string> names_;  ///< of the actuators, by the first pressures
  procedures::TipRecord record_;
  FaultCount foreign_;
  ros::Subscriber model_subscriber_, command_subscriber_, measured_subscriber_;
};

constexpr double kTick = 0.1;        // [s]
constexpr double kLastWords = 1.0;   // of the topics that are recorded, after the end [s]
constexpr double kWordPeriod = 1.0;  // between two lines of the log [s]

/// Private parameters of follow_path.
struct FollowPathOptions {
  ParameterReader reader{ros::NodeHandle("~")};
  /// CSV file, or name of a shipped path.
  std::string path = reader.file("path", "config/paths", ".csv");
  std::string action =
      reader.text("action", std::string(names::kVisualServoNode) + "/" + names::kFollowTipPath);
  std::string frame = reader.frame("frame", "");  ///< in which the path is seen; "", the arm's base
  /// 0: any distance; 0: 2 mm [m].
  double path_tolerance = 1e-3 * reader.number("path_tolerance_mm", 0.0, {0.0, 1000.0});
  double goal_tolerance = 1e-3 * reader.number("goal_tolerance_mm", 0.0, {0.0, 1000.0});
  bool require_vision = reader.flag("require_vision", false);  ///< abort where the arm is not seen
  double hold = reader.number("hold_s", 0.0, {0.0, 86400.0});  ///< 0: the loop's own [s]
  /// Longest wait for the action [s].
  double patience = reader.number("patience_s", 30.0, {0.0, 3600.0});
  /// Paths of files to write at the end; "", none.
  RunRecorder::Files files{reader.fileToWrite("record", ".csv"),
                           reader.fileToWrite("figure", ".png")};

  FollowPathOptions() { reader.finish(); }
};

FollowTipPathGoal goalOf(const FollowPathOptions& options) {
  FollowTipPathGoal out;
  out.path.header.frame_id = options.frame;
  for (const control::TipWayPoint& point : io::loadTipPath(io::loadDataSet(options.path))) {
    trajectory_msgs::MultiDOFJointTrajectoryPoint place;
    place.transforms.push_back(toTransformMsg({Eigen::Matrix3d::Identity(), point.position}));
    place.time_from_start = ros::Duration(point.time);
    out.path.points.push_back(place);
  }
  out.mode = FollowTipPathGoal::POSITION;
  out.path_tolerance = options.path_tolerance;
  out.goal_tolerance = options.goal_tolerance;
  out.require_vision = options.require_vision;
  out.hold_s = options.hold;
  return out;
}

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
class FollowPathNode : public Node {
 public:
  FollowPathNode()
      : goal_(goalOf(options_)),
        client_(node_, options_.action, false),
        timer_(repeat(node_, "the watch of the goal", kTick, &FollowPathNode::onTick, this)) {
    if (!options_.files.any()) return;
    recorder_.emplace(node_, options_.files, options_.path,
                      goal_.path.points.back().time_from_start.toSec());
  }

  /// Writes the record.
  int finish() override {
    if (!recorder_ || !sent_) return verdict_;
    const std::string fault = recorder_->write(outcome_);
    if (fault.empty()) return verdict_;
    logFatal("%s", fault.c_str());
    return kFailed;
  }

  /// Not while a goal is under way.
  bool mayEnd() const override { return !sent_ || done_; }

 private:
  using Client = actionlib::SimpleActionClient<FollowTipPathAction>;

  void onTick(const ros::SteadyTimerEvent&) {
    if (sent_ && !done_ && !cancelled_ && EndRequest::made()) {
      cancelled_ = true;
      client_.cancelGoal();
    }
    if (!mayEnd() && !client_.isServerConnected()) {
      logFatal("%s has ended before the path", node_.resolveName(options_.action).c_str());
      endWith(kFailed, "the action has ended before the path");
    }
    if (done_) endOnceRecorded();
    if (sent_) return;
    if (client_.isServerConnected()) {
      send();
    } else if (ros::SteadyTime::now() - start_ > ros::WallDuration(options_.patience)) {
      logFatal("no action %s for %g s; is visual_servo up (closed_loop:=true of arm.launch)?",
               node_.resolveName(options_.action).c_str(), options_.patience);
      verdict_ = kFailed;
      EndRequest::make();
    }
  }

  void send() {
    sent_ = true;
    logInfo("%s: %zu points, %.1f s", options_.path.c_str(), goal_.path.points.size(),
            goal_.path.points.back().time_from_start.toSec());
    client_.sendGoal(
        goal_,
        [this](const actionlib::SimpleClientGoalState& state,
               const FollowTipPathResultConstPtr& result) {
          guard_.run("", [&] { onDone(state, result.get()); });
        },
        Client::SimpleActiveCallback(),
        [this](const FollowTipPathFeedbackConstPtr& feedback) {
          guard_.run("", [&] { onFeedback(*feedback); });
        });
  }

  void onFeedback(const FollowTipPathFeedback& feedback) {
    if (recorder_) recorder_->add(feedback);
    const ros::SteadyTime now = ros::SteadyTime::now();
    if (now - last_word_ < ros::WallDuration(kWordPeriod)) return;
    last_word_ = now;
    logInfo("%.1f s: the tip is %.2f mm off, the loop %s", feedback.time_from_start.toSec(),
            1e3 * feedback.error, basics::quoted(feedback.state).c_str());
  }

  void onDone(const actionlib::SimpleClientGoalState& state, const FollowTipPathResult* result) {
    if (result == nullptr) {
      logFatal("the goal has ended without a result; is visual_servo still running?");
      return endWith(kFailed, "the goal has ended without a result");
    }
    const std::string message = basics::quoted(result->error_string, kLongestMessage);
    if (state == actionlib::SimpleClientGoalState::SUCCEEDED) {
      logInfo("the path was followed: %.2f mm RMS, at most %.2f mm, in %u pictures; %s",
              1e3 * result->rms_m, 1e3 * result->max_m, result->pictures, message.c_str());
      return endWith(kDone, message);
    }
    if (cancelled_) {
      logInfo("%s", message.c_str());
      return endWith(kDone, message);
    }
    logError("the path was not followed (%s, error_code %d): %s", state.toString().c_str(),
             result->error_code, message.c_str());
    endWith(kFailed, message);
  }

  void endWith(int verdict, const std::string& outcome) {
    done_ = true;
    done_since_ = ros::SteadyTime::now();
    verdict_ = verdict;
    outcome_ = outcome;
    endOnceRecorded();
  }

  // What the last pictures wait for comes within moments.
  void endOnceRecorded() {
    const bool waits = recorder_ && !recorder_->isComplete() &&
                       ros::SteadyTime::now() - done_since_ < ros::WallDuration(kLastWords);
    if (!waits) EndRequest::make();
  }

  const FollowPathOptions options_{};
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

}  // namespace

std::unique_ptr<Node> makeFollowPath() { return std::make_unique<FollowPathNode>(); }

}  // namespace helix_arm::ros_bridge
