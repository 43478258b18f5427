#include "monitor_node.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <utility>

#include <ros/names.h>

#include "helix_arm/basics/median.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/scene.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/names.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/vision/vision_ledger.hpp"

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

}  // namespace

MonitorOptions MonitorOptions::load() {
  ParameterReader reader{ros::NodeHandle("~")};
  MonitorOptions out;
  out.seconds = reader.number("seconds", out.seconds, {0.0, 86400.0});
  out.min_travel = reader.number("min_travel_m", out.min_travel, {0.0, 10.0});
  out.startup = reader.number("startup_s", out.startup, {0.1, 3600.0});
  out.min_rate = reader.number("min_rate", out.min_rate, {0.1, 1000.0});
  out.min_measured_rate = reader.number("min_measured_rate", out.min_measured_rate, {0.1, 1000.0});
  out.scene = reader.optionalFile("scene", "config/scenes", ".yaml");
  out.scene_folder = reader.folder("scene_folder", defaultFolder());
  reader.finish();
  return out;
}

void MonitorNode::Stream::arrived(bool is_finite) {
  last = ros::SteadyTime::now();
  if (count++ == 0) first = last;
  finite = finite && is_finite;
}

double MonitorNode::Stream::rate() const {
  const double seconds = (last - first).toSec();
  return count > 1 && seconds > 0 ? static_cast<double>(count - 1) / seconds : 0.0;
}

MonitorNode::MonitorNode()
    : options_(MonitorOptions::load()),
      start_(ros::SteadyTime::now()),
      command_{names::kPressureCommand, options_.min_rate},
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
  using Node = MonitorNode;
  command_subscriber_ = listen(node_, command_.topic, 1000, &Node::onCommand, this);
  measured_subscriber_ = listen(node_, measured_.topic, 1000, &Node::onMeasured, this);
  model_subscriber_ = listen(node_, model_.topic, 1000, &Node::onModel, this);
  shape_subscriber_ = listen(node_, shape_.topic, 1000, &Node::onShape, this);
  error_subscriber_ = listen(node_, names::kModelError, 1000, &Node::onModelError, this);
  vision_subscriber_ = listen(node_, names::kVisionStatus, 100, &Node::onVisionStatus, this);
  safety_subscriber_ = listen(node_, names::kSafetyState, 10, &Node::onSafety, this);
  diagnostics_subscriber_ = listen(node_, names::kDiagnostics, 10, &Node::onDiagnostics, this);
  timer_ = repeat(node_, "the lines", 1.0, &Node::onSecond, this);
}

void MonitorNode::onCommand(const PressureArrayConstPtr& command) {
  command_.arrived(allFinite(command->pressure));
}

void MonitorNode::onMeasured(const PressureArrayConstPtr& measured) {
  measured_.arrived(allFinite(measured->pressure));
  pressure_ = measured->pressure;
}

void MonitorNode::onModel(const ArmShapeConstPtr& model) {
  const auto& p = model->tip.position;
  tip_ = {p.x, p.y, p.z};
  if (tip_.allFinite()) reach_.extend(tip_);
  model_.arrived(allFinite(model->twist) && allFinite(model->piece_twist) && tip_.allFinite());
}

void MonitorNode::onShape(const ArmShapeConstPtr& shape) {
  shape_.arrived(allFinite(shape->twist) && allFinite(shape->piece_twist) &&
                 allFinite(shape->twist_covariance));
}

void MonitorNode::onModelError(const ModelErrorConstPtr& error) {
  model_error_ = *error;
  if (!std::isfinite(error->tip_error)) return;
  tip_errors_.push_back(error->tip_error);
  if (tip_errors_.size() > kMostErrors) tip_errors_.pop_front();
}

void MonitorNode::onVisionStatus(const VisionStatusConstPtr& status) { vision_ = *status; }

void MonitorNode::onSafety(const SafetyStateConstPtr& safety) { safety_ = *safety; }

void MonitorNode::onDiagnostics(const diagnostic_msgs::DiagnosticArrayConstPtr& diagnostics) {
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

void MonitorNode::onSecond(const ros::SteadyTimerEvent&) {
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

void MonitorNode::printLine(double seconds) {
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

std::string MonitorNode::safetyText() const {
  if (!safety_) return "";
  const bool usual = safety_->cause == control::nameOf(control::SafetyCause::kNone);
  return "  " + basics::quoted(safety_->state) +
         (usual ? "" : " (" + basics::quoted(safety_->cause) + ")");
}

std::string MonitorNode::visionText() const {
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

std::vector<const MonitorNode::Stream*> MonitorNode::expected() const {
  std::vector<const Stream*> out = {&command_, &measured_, &model_};
  // Measured shapes are expected only of a scene with camera and tags.
  if (scene_ && scene_->camera && scene_->tags) out.push_back(&shape_);
  return out;
}

std::vector<std::string> MonitorNode::faults() const {
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
    std::snprintf(text, sizeof text, "the tip moved within %.3f m; expected at least %g", travel(),
                  options_.min_travel);
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

double MonitorNode::travel() const { return reach_.isEmpty() ? 0.0 : reach_.diagonal().norm(); }

int MonitorNode::finish() {
  const double seconds = model_.count > 0 ? (ros::SteadyTime::now() - model_.first).toSec() : 0.0;
  std::printf(
      "summary: %.1f s, %s %.1f Hz, %s %.1f Hz, %s %.1f Hz, tip moved within %.3f m, dropped %lu\n",
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

}  // namespace helix_arm::ros_bridge
