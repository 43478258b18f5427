#include "command_link.hpp"

#include <algorithm>
#include <utility>
#include <variant>

#include "basics/quote.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

void CommandLink::send(const Eigen::VectorXd& pressure) {
  if (!speaks_ || follows()) asks_since_ = ros::SteadyTime::now();
  std_msgs::Header header = toHeaderMsg(ros::Time::now());
  if (!speaks_ || header.stamp < first_stamp_) first_stamp_ = header.stamp;
  speaks_ = true;
  rests_ = false;
  trace_.sent(header.stamp);
  target_publisher_.publish(toPressureMsg(header, scene_.arm, pressure));
}

void CommandLink::ask() {
  if (trace_.wasRested()) return;  // until pressure_command knows that this node knows
  send(scene_.arm.clamped(set_point_ ? *set_point_ : scene_.arm.inputAt(0)));
}

void CommandLink::fallSilent() {
  speaks_ = accepted_ = false;
  blocked_.clear();
  passing_.reset();
  lasting_.reset();
}

void CommandLink::rest() {
  rests_ = rests_ || follows() || trace_.awaitsAnswer();
  fallSilent();
}

void CommandLink::restIfDue() {
  const bool was_rested = trace_.wasRested();
  if ((!rests_ && !was_rested) || trace_.awaitsAnswer()) return;
  rests_ = false;
  if (was_rested || trace_.commands()) requestRest();
  trace_ = {};
}

std::optional<control::Refusal> CommandLink::refusal() const {
  if (!speaks_ || follows()) return std::nullopt;
  if (lasting_) return lasting_;
  const double patience = kLeasePatience + std::min(scene_.safety.commander_timeout, kLongestLease);
  if (ros::SteadyTime::now() - asks_since_ < ros::WallDuration(patience)) return std::nullopt;
  if (passing_ && isFresh()) return passing_;
  return control::Refusal{Fault::kNotEnabled, whyNot()};
}

std::string CommandLink::whyNot() const {
  if (!isFresh()) return "no pressure_command is received; is its node running?";
  if (lasting_) return lasting_->message;
  if (passing_) return passing_->message;
  if (!enabled_ && !safety_reason_.empty()) return safety_reason_;
  return "pressure_command does not answer on target_status";
}

void CommandLink::requestRest() {
  ros::NodeHandle node;
  ros::ServiceClient client = node.serviceClient<std_srvs::Trigger>(
      std::string(names::kPressureCommandNode) + "/" + names::kRest);
  std_srvs::Trigger rest;
  if (client.call(rest)) {
    return logInfo("%s: %s", client.getService().c_str(),
                   basics::quoted(rest.response.message, kLongestMessage).c_str());
  }
  // Nodes that are shut down together may miss each other.
  logLine(EndRequest::made() ? ros::console::levels::Info : ros::console::levels::Warn,
          "%s does not exist or does not answer: the arm vents once no target has come for "
          "safety.target_timeout_s, as after a fault",
          client.getService().c_str());
}

void CommandLink::onCommand(const PressureArrayConstPtr& command) {
  auto checked = control::checkReading(scene_.arm, command->name, command->pressure);
  if (auto* pressure = std::get_if<Eigen::VectorXd>(&checked)) {
    set_point_ = std::move(*pressure);
    last_command_ = ros::SteadyTime::now();
  } else if (bad_commands_.add()) {
    logWarning("a pressure_command was dropped (%lu so far): %s", bad_commands_.total(),
               std::get<control::Refusal>(checked).message.c_str());
  }
}

void CommandLink::onSafety(const SafetyStateConstPtr& state) {
  const bool was_enabled = std::exchange(enabled_, state->state == SafetyState::ENABLED);
  was_enabled_anew_ = was_enabled_anew_ || (enabled_ && !was_enabled);
  safety_reason_ = basics::quoted(state->reason, kLongestMessage);
  if (!enabled_) accepted_ = false;
}

void CommandLink::onStatus(const TargetStatusConstPtr& status) {
  if (status->topic != names::kPressureTarget) return;  // such as answers to targets of this node
  trace_.answered(*status);
  if (!speaks_ || status->commander != ros::this_node::getName() ||
      status->target_stamp < first_stamp_) {
    return;
  }
  const bool is_blocked = status->fault == control::nameOf(Fault::kBlocked);
  blocked_ = is_blocked ? basics::quoted(status->message, kLongestMessage) : "";
  if (status->outcome != TargetStatus::DROPPED || is_blocked) {
    accepted_ = true;
    passing_.reset();
    return;
  }
  const auto is = [&](Fault fault) { return status->fault == control::nameOf(fault); };
  const Fault fault = is(Fault::kOtherCommander) ? Fault::kOtherCommander
                      : is(Fault::kRested)       ? Fault::kRested
                                                 : Fault::kNotEnabled;
  const control::Refusal refusal{fault, basics::quoted(status->message, kLongestMessage)};
  const bool stale = is(Fault::kStale);
  // A commander that had the arm and lost it does not wait for it again.
  const bool passes = stale || (is(Fault::kOtherCommander) && !accepted_);
  accepted_ = accepted_ && stale;
  (passes ? passing_ : lasting_) = refusal;
}

bool CommandLink::isFresh() const {
  return !last_command_.isZero() &&
         ros::SteadyTime::now() - last_command_ < ros::WallDuration(kFreshCommand);
}

}  // namespace helix_arm::ros_bridge
