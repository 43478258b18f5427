#include "helix_arm/ros_bridge/master_watch.hpp"

#include <ros/console.h>
#include <ros/init.h>
#include <ros/master.h>
#include <ros/this_node.h>

namespace helix_arm::ros_bridge {
namespace {

// A master that was restarted answers, but only one that holds our registrations can find us.
bool masterKnowsUs() {
  XmlRpc::XmlRpcValue request, response, payload;
  request[0] = ros::this_node::getName();
  request[1] = ros::this_node::getName();
  return ros::master::execute("lookupNode", request, response, payload, false);
}

}  // namespace

MasterWatch::MasterWatch(std::chrono::milliseconds period, int misses)
    : thread_([this, period, misses] { watch(period, misses); }) {}

MasterWatch::~MasterWatch() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void MasterWatch::watch(std::chrono::milliseconds period, int misses) {
  int missed = 0;
  std::unique_lock<std::mutex> lock(mutex_);
  while (!wake_.wait_for(lock, period, [this] { return stop_; })) {
    lock.unlock();
    missed = masterKnowsUs() ? 0 : missed + 1;
    if (missed >= misses && ros::ok()) {
      ROS_FATAL("the ROS master at %s %s: this node ends", ros::master::getURI().c_str(),
                ros::master::check() ? "was restarted and does not know this node" : "is gone");
      lost_ = true;
      ros::requestShutdown();
      return;
    }
    lock.lock();
  }
}

}  // namespace helix_arm::ros_bridge
