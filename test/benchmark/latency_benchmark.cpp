// Pressure target in, command out: the time from publishing a target to the command that carries
// it, through roscpp, to a node of its own. Needs a running pressure_command; prints p50 and p99.
#include <algorithm>
#include <cstdio>
#include <vector>

#include <ros/callback_queue.h>
#include <ros/ros.h>

#include "helix_arm/PressureArray.h"
#include "ros_bridge/names.hpp"

namespace {

constexpr int kTargets = 2000;
constexpr double kRetry = 0.1;      // [s]
constexpr double kDeadline = 30.0;  // for the node to come up, and for any one answer [s]

double now() { return ros::SteadyTime::now().toSec(); }

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "latency_benchmark", ros::init_options::AnonymousName);
  for (const double start = now(); !ros::master::check();) {
    if (now() - start > kDeadline) {
      std::fprintf(stderr, "no ROS master at %s; start pressure_command first\n",
                   ros::master::getURI().c_str());
      return 1;
    }
    ros::WallDuration(0.1).sleep();
  }
  ros::NodeHandle node;
  const ros::TransportHints hints = ros::TransportHints().tcpNoDelay();
  double wanted = -1.0;
  double answered = 0.0;
  const auto onCommand = [&](const helix_arm::PressureArray::ConstPtr& command) {
    if (command->pressure.front() == wanted) answered = now();
  };
  const auto subscriber = node.subscribe<helix_arm::PressureArray>(
      helix_arm::ros_bridge::names::kPressureCommand, 100,
      boost::function<void(const helix_arm::PressureArray::ConstPtr&)>(onCommand),
      ros::VoidConstPtr(), hints);
  const auto publisher =
      node.advertise<helix_arm::PressureArray>(helix_arm::ros_bridge::names::kPressureTarget, 10);

  std::vector<double> microseconds;
  for (int i = -100; i < kTargets; ++i) {  // the first ones warm up
    wanted = 1e5 + i;
    answered = 0.0;
    helix_arm::PressureArray target;
    target.pressure = {wanted, 0, 0};
    double sent = 0.0;
    for (const double start = now(); answered == 0.0;) {
      if (now() - start > kDeadline) {
        std::fprintf(stderr,
                     "no command came back; is pressure_command running with three muscles?\n");
        return 1;
      }
      // The first one enables the arm, once its regulator has been heard of.
      const bool again = i < 0 && now() - sent > kRetry;
      if ((sent == 0.0 || again) && publisher.getNumSubscribers() > 0 &&
          subscriber.getNumPublishers() > 0) {
        target.header.stamp = ros::Time::now();
        sent = now();
        publisher.publish(target);
      }
      ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.01));
    }
    if (i >= 0) microseconds.push_back(1e6 * (answered - sent));
  }
  std::sort(microseconds.begin(), microseconds.end());
  std::printf("pressure target -> command through roscpp, %d targets: p50 %.0f us, p99 %.0f us\n",
              kTargets, microseconds[kTargets / 2], microseconds[kTargets * 99 / 100]);
  return 0;
}
