#include "pressure_series_node.hpp"

#include <algorithm>
#include <sstream>
#include <stdexcept>
#include <vector>

#include <ros/this_node.h>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/data_set.hpp"
#include "helix_arm/procedures/pressure_plan.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/names.hpp"
#include "ros_bridge/common/parameters.hpp"

namespace helix_arm::ros_bridge {
namespace {

// Refusals, and commands of another arm, end the series only after this number of consecutive
// messages over this time.
constexpr int kLeastTrouble = 10;
constexpr double kLongestTrouble = 2;  // [s]
constexpr double kLongestStep = 0.1;   // after a pause of the node, the series does not jump [s]

// The rows to play; each of them must be a valid target.
Eigen::MatrixXd loadRows(const PressureSeriesOptions& options, const model::Arm& arm) {
  if (options.data.empty()) return procedures::pressureTour(arm);
  const io::DataSet data = io::loadDataSet(options.data);
  Eigen::MatrixXd rows = io::pressuresOf(data, arm.actuatorCount());
  std::string without;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    const std::string column = "pressure_" + std::to_string(i + 1) + "_kpa";
    if (data.find(column) < 0) without += (without.empty() ? "" : ", ") + arm.actuator(i).name;
  }
  if (!without.empty()) {
    logWarning("%s has no column for %s: they stay at 0; is it for another arm?",
               options.data.c_str(), without.c_str());
  }
  const Eigen::VectorXd rest = Eigen::VectorXd::Zero(arm.actuatorCount());
  std::ostringstream faults;
  for (int row = 0; row < rows.rows(); ++row) {
    const Eigen::VectorXd wanted = rows.row(row);
    const std::vector<double> pressure(wanted.begin(), wanted.end());
    const auto checked = control::checkPressures(arm, rest, {}, pressure);
    if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
      faults << options.data << " row " << row + 1 << ": " << refusal->message << "\n";
    }
  }
  if (!faults.str().empty()) throw std::invalid_argument(faults.str());
  return rows;
}

// Refusals that do not depend on the values of the target: the arm is not enabled, or was brought
// to rest by somebody else; messages are late, or clocks differ.
bool passes(const std::string& fault) {
  return fault == control::nameOf(control::Fault::kNotEnabled) ||
         fault == control::nameOf(control::Fault::kRested) ||
         fault == control::nameOf(control::Fault::kStale);
}

}  // namespace

PressureSeriesOptions PressureSeriesOptions::load() {
  ParameterReader reader{ros::NodeHandle("~")};
  PressureSeriesOptions out;
  out.scene = reader.file("scene", "config/scenes", ".yaml");
  out.data = reader.optionalFile("data", "config/series", ".csv");
  out.timing.ramp = reader.number("ramp_s", out.timing.ramp, {0.0, 3600.0});
  out.timing.hold = reader.number("hold_s", out.timing.hold, {0.0, 3600.0});
  out.timing.loop = reader.flag("loop", out.timing.loop);
  out.rate = reader.number("rate", out.rate, {1.0, 1000.0});
  out.yields = reader.flag("yields", out.yields);
  out.resume_after = reader.number("resume_after_s", out.resume_after, {0.1, 3600.0});
  reader.finish();
  return out;
}

PressureSeriesNode::PressureSeriesNode()
    : options_(PressureSeriesOptions::load()),
      scene_(io::loadScene(options_.scene)),
      rows_(loadRows(options_, scene_.arm)) {
  using Node = PressureSeriesNode;
  target_publisher_ = node_.advertise<PressureArray>(names::kPressureTarget, 10);
  command_subscriber_ = listen(node_, names::kPressureCommand, 10, &Node::onCommand, this);
  status_subscriber_ = listen(node_, names::kTargetStatus, 100, &Node::onStatus, this);
  timer_ = repeat(node_, "the series", 1.0 / options_.rate, &Node::onTick, this);
}

bool PressureSeriesNode::Trouble::goesOn() {
  const ros::SteadyTime now = ros::SteadyTime::now();
  if (messages++ == 0) since = now;
  return messages >= kLeastTrouble && now - since >= ros::WallDuration(kLongestTrouble);
}

void PressureSeriesNode::suffer(Trouble& trouble, const std::string& what) {
  if (trouble.warnings.add()) logWarning("%s", what.c_str());
  if (!trouble.goesOn() || verdict_ != kDone) return;
  logFatal("%s, and nothing else for %g s", what.c_str(), kLongestTrouble);
  verdict_ = kFailed;
  EndRequest::make();
}

void PressureSeriesNode::onCommand(const PressureArrayConstPtr& command) {
  const auto checked = control::checkReading(scene_.arm, command->name, command->pressure);
  if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
    suffer(foreign_,
           "pressure_command does not match scene " + scene_.name + ": " + refusal->message);
    return;
  }
  foreign_.messages = 0;
  command_ = scene_.arm.clamped(std::get<Eigen::VectorXd>(checked));  // vented: the atmosphere
  if (!player_) player_.emplace(rows_, command_, options_.timing);
}

void PressureSeriesNode::onStatus(const TargetStatusConstPtr& status) {
  trace_.answered(*status);
  const bool mine = status->commander == ros::this_node::getName();
  const std::string message = basics::quoted(status->message, kLongestMessage);
  if (mine && passes(status->fault)) {
    refused_.messages = 0;
    if (waits_.add()) logWarning("the series waits: %s", message.c_str());
    held_back_ = true;
    return;
  }
  if (mine && held_back_ && status->outcome != TargetStatus::DROPPED) {
    logInfo("targets are accepted again: the series continues");
    held_back_ = false;
    if (player_) player_->resume(command_);
  }
  const bool refused_to_command = status->fault == control::nameOf(control::Fault::kOtherCommander);
  const bool others_command =
      mine ? refused_to_command : refused_to_command || status->outcome != TargetStatus::DROPPED;
  const bool waits = options_.yields && others_command;
  if (mine && status->outcome == TargetStatus::DROPPED && !waits) {
    suffer(refused_, "the series was refused: " + message);
  } else if (mine) {
    refused_.messages = 0;
  }
  if (!waits) return;
  if (!yielding_) logInfo("another commander sends targets: the series waits");
  yielding_ = true;
  last_of_others_ = ros::SteadyTime::now();
}

void PressureSeriesNode::onTick(const ros::SteadyTimerEvent&) {
  const ros::SteadyTime now = ros::SteadyTime::now();
  const double dt = last_tick_.isZero() ? 0.0 : std::min((now - last_tick_).toSec(), kLongestStep);
  last_tick_ = now;
  if (over_ || EndRequest::made()) return endSeries();
  if (!player_ || target_publisher_.getNumSubscribers() == 0) return;
  if (yielding_) {
    if ((now - last_of_others_).toSec() < options_.resume_after) return;
    logInfo("the series continues");
    yielding_ = false;
    player_->resume(command_);
  } else if (!held_back_) {
    player_->advance(dt);
  }
  if (player_->row() != told_row_) {
    told_row_ = player_->row();
    static const Eigen::IOFormat kPlain(4, Eigen::DontAlignCols, " ");
    std::ostringstream text;
    text << (1e-3 * rows_.row(told_row_)).format(kPlain);
    logInfo("row %d of %d: %s kPa", told_row_ + 1, static_cast<int>(rows_.rows()),
            text.str().c_str());
  }
  publishTarget();
  over_ = player_->finished();
  if (over_) logInfo("the series has ended");
}

void PressureSeriesNode::publishTarget() {
  std_msgs::Header header;
  header.stamp = ros::Time::now();
  const Eigen::VectorXd target = held_back_ ? command_ : player_->pressure();
  target_publisher_.publish(toPressureMsg(header, scene_.arm, target));
  trace_.sent(header.stamp);
}

bool PressureSeriesNode::mayBeUnheard() const { return trace_.isUnheard() && !yielding_; }

bool PressureSeriesNode::mayCommand() const {
  return trace_.commands() || trace_.awaitsAnswer() || (mayBeUnheard() && end_began_.isZero());
}

void PressureSeriesNode::endSeries() {
  if (EndRequest::isUrgent()) return;  // without a master, the call would block
  const ros::SteadyTime now = ros::SteadyTime::now();
  if (end_began_.isZero()) end_began_ = now;
  // The arm may follow a target whose answer came before target_status was connected.
  if (mayBeUnheard() && now - end_began_ < ros::WallDuration(CommandTrace::kPatience)) {
    return publishTarget();
  }
  if (trace_.awaitsAnswer()) return;
  if (trace_.commands()) requestRest();
  EndRequest::make();
}

}  // namespace helix_arm::ros_bridge
