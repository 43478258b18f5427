#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <deque>

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/names.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/ModelError.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/SafetyState.h"
#include "helix_arm/VisionStatus.h"
#include "helix_arm/basics/median.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/scene.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/reload_server.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"
#include "ros_bridge/vision/pictures.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr std::size_t kMostErrors = 100000;  // an hour's at 30 Hz
constexpr std::size_t kMostPressures = 100;  // printed per line
constexpr double kSilence = 2.0;  // a topic silent for this long at the end has stopped [s]

bool allFinite(const std::vector<double>& values) {
  for (const double value : values) {
    if (!std::isfinite(value)) return false;
  }
  return true;
}

std::uint64_t countOf(const diagnostic_msgs::DiagnosticStatus& status, const std::string& key) {
  return std::strtoull(valueOf(status, key).c_str(), nullptr, 10);
}

/// Private parameters of monitor.
struct MonitorOptions {
  ParameterReader reader{ros::NodeHandle("~")};
  /// Duration after the first model; 0: until asked to end [s].
  double seconds = reader.number("seconds", 0.0, {0.0, 86400.0});
  /// Minimum travel of the tip [m].
  double min_travel = reader.number("min_travel_m", 0.0, {0.0, 10.0});
  /// Longest wait for the first model, if ~seconds is set [s].
  double startup = reader.number("startup_s", 30.0, {0.1, 3600.0});
  /// Slowest healthy rates: of each topic, and of `measured` [Hz].
  double min_rate = reader.number("min_rate", 10.0, {0.1, 1000.0});
  double min_measured_rate = reader.number("min_measured_rate", 2.0, {0.1, 1000.0});
  /// As pressure_command's; if it has camera and tags, `measured` is required as well. Without a
  /// scene, `measured` is shown but not required.
  std::string scene = reader.optionalFile("scene", "config/scenes", ".yaml");
  std::string scene_folder = reader.folder("scene_folder", defaultFolder());  ///< likewise

  MonitorOptions() { reader.finish(); }
};

/// Watches a running arm from outside: prints one line per second, and a verdict at the end.
///
/// Subscribes
/// - pressure_command, pressure_measured (PressureArray)
/// - model, measured (ArmShape); model_error (ModelError); vision_status (VisionStatus)
/// - safety_state (SafetyState): shown in each line
/// - /diagnostics (diagnostic_msgs/DiagnosticArray): those of pressure_command in its namespace
///
/// Service
/// - ~reload (Reload), if ~scene is set: another file of the same rig
///
/// Prints to stdout. Parameters: MonitorOptions.
///
/// Ends with 0 if pressures and shapes arrived to the end at ~min_rate or more, with finite
/// numbers, diagnostics without error and no dropped target (except those of a second commander,
/// while the arm was not enabled, and late ones); otherwise with 1 and the reason; 2 on a bad scene
/// or parameter.
class MonitorNode : public Node {
 public:
  MonitorNode()
      : command_{names::kPressureCommand, options_.min_rate},
        measured_{names::kPressureMeasured, options_.min_rate},
        model_{names::kModel, options_.min_rate},
        shape_{names::kMeasured, options_.min_measured_rate},
        last_line_(start_) {
    if (!options_.scene.empty()) {
      scene_ = io::loadScene(options_.scene);
      reload_ = std::make_unique<ReloadServer>(ros::NodeHandle("~"), options_.scene,
                                               options_.scene_folder, [this](io::Scene next) {
                                                 requireSameRig(*scene_, next);
                                                 scene_ = std::move(next);
                                               });
    }
    using Self = MonitorNode;
    command_subscriber_ = listen(node_, command_.topic, 1000, &Self::onCommand, this);
    measured_subscriber_ = listen(node_, measured_.topic, 1000, &Self::onMeasured, this);
    model_subscriber_ = listen(node_, model_.topic, 1000, &Self::onModel, this);
    shape_subscriber_ = listen(node_, shape_.topic, 1000, &Self::onShape, this);
    error_subscriber_ = listen(node_, names::kModelError, 1000, &Self::onModelError, this);
    vision_subscriber_ = listen(node_, names::kVisionStatus, 100, &Self::onVisionStatus, this);
    safety_subscriber_ = listen(node_, names::kSafetyState, 10, &Self::onSafety, this);
    diagnostics_subscriber_ = listen(node_, names::kDiagnostics, 10, &Self::onDiagnostics, this);
    timer_ = repeat(node_, "the lines", 1.0, &Self::onSecond, this);
  }

  /// Prints the summary and gives the verdict.
  int finish() override {
    const double seconds = model_.count > 0 ? (ros::SteadyTime::now() - model_.first).toSec() : 0.0;
    std::printf(
        "summary: %.1f s, %s %.1f Hz, %s %.1f Hz, %s %.1f Hz, tip moved within %.3f m, dropped "
        "%lu\n",
        seconds, command_.topic.c_str(), command_.rate(), measured_.topic.c_str(), measured_.rate(),
        model_.topic.c_str(), model_.rate(), travel(), static_cast<unsigned long>(dropped_));
    if (shape_.count > 0) {
      std::printf("%s %.1f Hz", shape_.topic.c_str(), shape_.rate());
      if (!tip_errors_.empty()) {
        std::printf(", model off by %.1f mm at the tip (median of %lu)",
                    1e3 * basics::medianOf({tip_errors_.begin(), tip_errors_.end()}),
                    static_cast<unsigned long>(tip_errors_.size()));
      }
      std::printf("\n");
    }
    const std::vector<std::string> found = faults();
    for (const std::string& fault : found) std::printf("fault: %s\n", fault.c_str());
    std::printf("verdict: %s\n", found.empty() ? "the arm runs" : "not healthy");
    return found.empty() ? kDone : kFailed;
  }

 private:
  /// Statistics of one topic.
  struct Stream {
    std::string topic;
    double min_rate;  ///< slowest healthy one [Hz]
    std::uint64_t count = 0;
    std::uint64_t printed = 0;  ///< count at the last line
    ros::SteadyTime first{}, last{};
    bool finite = true;

    void arrived(bool is_finite) {
      last = ros::SteadyTime::now();
      if (count++ == 0) first = last;
      finite = finite && is_finite;
    }
    /// Mean over the whole time [Hz].
    double rate() const {
      const double seconds = (last - first).toSec();
      return count > 1 && seconds > 0 ? static_cast<double>(count - 1) / seconds : 0.0;
    }
  };

  void onCommand(const PressureArrayConstPtr& command) {
    command_.arrived(allFinite(command->pressure));
  }

  void onMeasured(const PressureArrayConstPtr& measured) {
    measured_.arrived(allFinite(measured->pressure));
    pressure_ = measured->pressure;
  }

  void onModel(const ArmShapeConstPtr& model) {
    const auto& p = model->tip.position;
    tip_ = {p.x, p.y, p.z};
    if (tip_.allFinite()) reach_.extend(tip_);
    model_.arrived(allFinite(model->twist) && allFinite(model->piece_twist) && tip_.allFinite());
  }

  void onShape(const ArmShapeConstPtr& shape) {
    shape_.arrived(allFinite(shape->twist) && allFinite(shape->piece_twist) &&
                   allFinite(shape->twist_covariance));
  }

  void onModelError(const ModelErrorConstPtr& error) {
    model_error_ = *error;
    if (!std::isfinite(error->tip_error)) return;
    tip_errors_.push_back(error->tip_error);
    if (tip_errors_.size() > kMostErrors) tip_errors_.pop_front();
  }

  void onVisionStatus(const VisionStatusConstPtr& status) { vision_ = *status; }
  void onSafety(const SafetyStateConstPtr& safety) { safety_ = *safety; }

  void onDiagnostics(const diagnostic_msgs::DiagnosticArrayConstPtr& diagnostics) {
    const std::string node = ros::names::resolve(names::kPressureCommandNode).substr(1) + ": ";
    for (const auto& status : diagnostics->status) {
      if (status.name.compare(0, node.size(), node) != 0) continue;
      diagnosed_ = true;
      if (status.level >= diagnostic_msgs::DiagnosticStatus::ERROR) {
        error_ = basics::quoted(status.message, kLongestMessage);
      }
      if (status.name != node + names::kTargetsStatus) continue;
      dropped_ = countOf(status, names::kDroppedKey);
      const auto countOfDropped = [&](control::Fault fault) {
        return countOf(status, std::string(names::kDroppedPrefix) + control::nameOf(fault));
      };
      refused_ = countOfDropped(control::Fault::kOtherCommander) +
                 countOfDropped(control::Fault::kNotEnabled) +
                 countOfDropped(control::Fault::kRested) + countOfDropped(control::Fault::kStale);
      last_fault_ = basics::quoted(valueOf(status, names::kLastFaultKey), kLongestMessage);
    }
  }

  void onSecond(const ros::SteadyTimerEvent&) {
    const ros::SteadyTime now = ros::SteadyTime::now();
    if (model_.count == 0) {
      std::printf("waiting for %s\n", ros::names::resolve(model_.topic).c_str());
      last_line_ = now;
      const bool given_up = options_.seconds > 0 && (now - start_).toSec() > options_.startup;
      if (given_up) EndRequest::make();
      return;
    }
    const double seconds = (now - model_.first).toSec();
    printLine(seconds);
    if (options_.seconds > 0 && seconds >= options_.seconds) EndRequest::make();
  }

  void printLine(double seconds) {
    const ros::SteadyTime now = ros::SteadyTime::now();
    const double elapsed = (now - last_line_).toSec();
    last_line_ = now;
    std::string line;
    char part[64];
    std::snprintf(part, sizeof part, "%7.1f s  kPa", seconds);
    line += part;
    for (std::size_t i = 0; i < std::min(pressure_.size(), kMostPressures); ++i) {
      std::snprintf(part, sizeof part, " %6.1f", pressure_[i] / 1e3);
      line += part;
    }
    if (pressure_.size() > kMostPressures) line += " ...";
    std::snprintf(part, sizeof part, "  tip %6.3f %6.3f %6.3f m ", tip_.x(), tip_.y(), tip_.z());
    line += part;
    for (Stream* stream : {&command_, &measured_, &model_, &shape_}) {
      if (stream == &shape_ && !vision_) continue;
      const auto fresh = static_cast<double>(stream->count - stream->printed);
      stream->printed = stream->count;
      std::snprintf(part, sizeof part, " %s %.0f Hz", stream->topic.c_str(), fresh / elapsed);
      line += part;
    }
    std::printf("%s%s  dropped %lu%s\n", line.c_str(), visionText().c_str(),
                static_cast<unsigned long>(dropped_), safetyText().c_str());
  }

  std::string visionText() const {
    if (!vision_) return "";
    if (vision_->state != VisionStatus::MEASURED) {
      return std::string(" (") + nameOfState(vision_->state) + ")";
    }
    std::string text = " (" + std::to_string(vision_->tags) + " tags";
    if (model_error_) {
      text += ", model off by " + fixed(1e3 * model_error_->tip_error) + " mm, " +
              fixed(model_error_->tip_error_percent) + " %";
    }
    return text + ")";
  }

  std::string safetyText() const {
    if (!safety_) return "";
    const bool usual = safety_->cause == control::nameOf(control::SafetyCause::kNone);
    return "  " + basics::quoted(safety_->state) +
           (usual ? "" : " (" + basics::quoted(safety_->cause) + ")");
  }

  std::vector<const Stream*> expected() const {
    std::vector<const Stream*> out = {&command_, &measured_, &model_};
    // Measured shapes are expected only of a scene with camera and tags.
    if (scene_ && scene_->camera && scene_->tags) out.push_back(&shape_);
    return out;
  }

  /// diagonal of the bounding box of the tip [m]
  double travel() const { return reach_.isEmpty() ? 0.0 : reach_.diagonal().norm(); }

  std::vector<std::string> faults() const {
    std::vector<std::string> out;
    char text[256];
    const ros::SteadyTime now = ros::SteadyTime::now();
    for (const Stream* stream : expected()) {
      const char* topic = stream->topic.c_str();
      if (stream->count == 0) {
        std::snprintf(text, sizeof text, "nothing came on %s", topic);
      } else if ((now - stream->last).toSec() > kSilence) {
        std::snprintf(text, sizeof text, "%s fell silent %.1f s before the end", topic,
                      (now - stream->last).toSec());
      } else if (stream->rate() < stream->min_rate) {
        std::snprintf(text, sizeof text, "%s came at %.1f Hz; expected at least %g", topic,
                      stream->rate(), stream->min_rate);
      } else if (!stream->finite) {
        std::snprintf(text, sizeof text, "%s held numbers that are not finite", topic);
      } else {
        continue;
      }
      out.emplace_back(text);
    }
    if (travel() < options_.min_travel) {
      std::snprintf(text, sizeof text, "the tip moved within %.3f m; expected at least %g",
                    travel(), options_.min_travel);
      out.emplace_back(text);
    }
    if (!diagnosed_) out.emplace_back("no diagnostics of pressure_command came");
    if (!error_.empty()) out.push_back("diagnostics: " + error_);
    if (dropped_ > refused_) {
      out.push_back(std::to_string(dropped_ - refused_) +
                    " targets were dropped, last fault: " + last_fault_);
    }
    return out;
  }

  const MonitorOptions options_{};
  std::optional<io::Scene> scene_;  ///< of ~scene
  const ros::SteadyTime start_ = ros::SteadyTime::now();
  Stream command_, measured_, model_, shape_;  ///< shape_ of the topic `measured`
  ros::SteadyTime last_line_;
  std::vector<double> pressure_;                   ///< last measured [Pa]
  Eigen::Vector3d tip_ = Eigen::Vector3d::Zero();  ///< of the last model, base frame [m]
  Eigen::AlignedBox3d reach_;                      ///< of all tips
  std::optional<ModelError> model_error_;          ///< the last one
  std::optional<VisionStatus> vision_;             ///< the last one
  std::optional<SafetyState> safety_;              ///< the last one
  std::deque<double> tip_errors_;                  ///< of the latest model_error [m]
  bool diagnosed_ = false;
  std::uint64_t dropped_ = 0;  ///< since the node started
  /// Of these, for a second commander, while it was not enabled, or late.
  std::uint64_t refused_ = 0;
  std::string last_fault_;
  std::string error_;  ///< message of the last status at level ERROR

  ros::NodeHandle node_;
  ros::Subscriber command_subscriber_, measured_subscriber_, model_subscriber_;
  ros::Subscriber shape_subscriber_, error_subscriber_, vision_subscriber_;
  ros::Subscriber diagnostics_subscriber_, safety_subscriber_;
  std::unique_ptr<ReloadServer> reload_;
  ros::SteadyTimer timer_;
};

}  // namespace

std::unique_ptr<Node> makeMonitor() { return std::make_unique<MonitorNode>(); }

}  // namespace helix_arm::ros_bridge
