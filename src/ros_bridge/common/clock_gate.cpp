#include "clock_gate.hpp"

#include <ros/init.h>
#include <ros/master.h>
#include <ros/this_node.h>

#include "guarded_callbacks.hpp"
#include "log.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

double MovingClock::now() {
  const ros::Time time = ros::Time::now();
  const ros::SteadyTime steady = ros::SteadyTime::now();
  if (time != last_ || since_.isZero()) since_ = steady;
  last_ = time;
  const double still = (steady - since_).toSec();
  stands_ = still > kPatience;
  return stands_ ? time.toSec() + still : time.toSec();
}

namespace {

constexpr std::uint32_t kEndOfTime = 1U << 31U;  // [s]
constexpr std::uint32_t kNanosecondsASecond = 1000000000;
constexpr char kParameter[] = "/use_sim_time";
// Given to roscpp instead, so that it does not subscribe to the clock; nobody sets it.
constexpr char kNoParameter[] = "/use_sim_time_of_roscpp_alone";

// Asks the master directly, since roscpp remaps the name of the parameter.
bool timeIsSimulated() {
  XmlRpc::XmlRpcValue request, response, value;
  request[0] = ros::this_node::getName();
  request[1] = kParameter;
  return ros::master::execute("getParam", request, response, value, false) &&
         value.getType() == XmlRpc::XmlRpcValue::TypeBoolean && static_cast<bool>(value);
}

}  // namespace

void ClockGate::init(int argc, char** argv, const std::string& name) {
  std::string remapping = std::string(kParameter) + ":=" + kNoParameter;
  std::vector<char*> arguments(argv, argv + argc);
  arguments.push_back(remapping.data());
  int count = static_cast<int>(arguments.size());
  arguments.push_back(nullptr);
  ros::init(count, arguments.data(), name);
}

bool ClockGate::isSound(const ros::Time& time) {
  return time.sec < kEndOfTime && time.nsec < kNanosecondsASecond;
}

ClockGate::ClockGate() : spinner_(1, &queue_) {
  if (!timeIsSimulated()) return;
  ros::Time::setNow(ros::Time());  // until the first message
  ros::NodeHandle node;
  node.setCallbackQueue(&queue_);
  subscriber_ = listen(node, names::kClock, 1, &ClockGate::onClock, this);
  spinner_.start();
}

void ClockGate::onClock(const rosgraph_msgs::Clock::ConstPtr& message) {
  const ros::Time& time = message->clock;
  if (isSound(time)) {
    ros::Time::setNow(time);
  } else if (bad_times_.add()) {
    logWarning(
        "%s gives %u s and %u ns, beyond the range of ROS time (2^31 s): the message is ignored "
        "(%lu times so far); stop the node that publishes it",
        names::kClock, time.sec, time.nsec, bad_times_.total());
  }
}

}  // namespace helix_arm::ros_bridge
