#include "ros_bridge/common/end_request.hpp"

#include <atomic>
#include <csignal>

#include <ros/xmlrpc_manager.h>

namespace helix_arm::ros_bridge {
namespace {

constexpr int kUrgent = 2;

std::atomic<int> requests{0};
static_assert(std::atomic<int>::is_always_lock_free, "signal handlers must not wait");

void onSignal(int) { requests.fetch_add(1); }

// Call by the master, as sent by rosnode kill.
void onShutdown(XmlRpc::XmlRpcValue&, XmlRpc::XmlRpcValue& result) {
  requests.fetch_add(1);
  result = ros::xmlrpc::responseInt(1, "", 0);
}

}  // namespace

EndRequest::EndRequest() {
  std::signal(SIGINT, onSignal);
  std::signal(SIGTERM, onSignal);
  const auto& manager = ros::XMLRPCManager::instance();
  manager->unbind("shutdown");
  manager->bind("shutdown", onShutdown);
}

void EndRequest::make() { requests.fetch_add(kUrgent); }
bool EndRequest::made() { return requests > 0; }
bool EndRequest::isUrgent() { return requests >= kUrgent; }

}  // namespace helix_arm::ros_bridge
