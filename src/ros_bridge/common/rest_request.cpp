#include "rest_request.hpp"

#include <ros/node_handle.h>
#include <std_srvs/Trigger.h>

#include "diagnostics.hpp"
#include "helix_arm/basics/quote.hpp"
#include "ros_bridge/names.hpp"
#include "run_node.hpp"

namespace helix_arm::ros_bridge {

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
