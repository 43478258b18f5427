#include "rest_request.hpp"

#include <ros/node_handle.h>
#include <ros/this_node.h>
#include <std_srvs/Trigger.h>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/control/target_check.hpp"
#include "log.hpp"
#include "ros_bridge/names.hpp"
#include "run_node.hpp"

namespace helix_arm::ros_bridge {
void CommandTrace::sent(const ros::Time& stamp) {
  last_stamp_ = stamp;
  last_sent_ = ros::SteadyTime::now();
  waits_ = true;
}

void CommandTrace::answered(const TargetStatus& status) {
  const bool accepted = status.outcome != TargetStatus::DROPPED;
  if (status.commander != ros::this_node::getName()) {
    accepted_ = accepted_ && !accepted;
    rested_ = rested_ && !accepted;
    return;
  }
  accepted_ = accepted;
  rested_ = status.fault == control::nameOf(control::Fault::kRested);
  heard_ = true;
  if (status.target_stamp == last_stamp_) waits_ = false;
}

bool CommandTrace::commands() const { return accepted_ && (!waits_ || awaitsAnswer()); }

bool CommandTrace::awaitsAnswer() const {
  return waits_ && ros::SteadyTime::now() - last_sent_ <= ros::WallDuration(kPatience);
}

void requestRest() {
  ros::NodeHandle node;
  ros::ServiceClient client = node.serviceClient<std_srvs::Trigger>(
      std::string(names::kPressureCommandNode) + "/" + names::kRest);
  std_srvs::Trigger rest;
  if (client.call(rest)) {
    logInfo("%s: %s", client.getService().c_str(),
            basics::quoted(rest.response.message, kLongestMessage).c_str());
    return;
  }
  // Nodes that are shut down together may miss each other.
  logLine(EndRequest::made() ? ros::console::levels::Info : ros::console::levels::Warn,
          "%s does not exist or does not answer: the arm vents once no target has come for "
          "safety.target_timeout_s, as after a fault",
          client.getService().c_str());
}

}  // namespace helix_arm::ros_bridge
