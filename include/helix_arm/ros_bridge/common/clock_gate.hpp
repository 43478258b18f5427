#pragma once

#include <string>

#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>
#include <rosgraph_msgs/Clock.h>

#include "helix_arm/ros_bridge/common/diagnostics.hpp"

namespace helix_arm::ros_bridge {

/// Gives a process its simulated time from /clock, unless ROS could not count with it.
///
/// roscpp takes whatever time comes. Sums and differences of times throw where they leave 32 bits,
/// also in threads of roscpp and actionlib where nobody can catch that: one message would end the
/// process. Times from 2^31 s on, and such with 10^9 ns or more, are dropped, counted and warned
/// of. Without /use_sim_time there is nothing to do.
class ClockGate {
 public:
  /// ros::init(), with simulated time kept from roscpp itself: it neither reads /use_sim_time nor
  /// listens to /clock.
  static void init(int argc, char** argv, const std::string& name);

  /// Whether ROS can count with a time: it is below 2^31 s, with less than 10^9 ns.
  static bool isSound(const ros::Time& time);

  /// Takes the time from now on, in a thread of its own, where /use_sim_time says so. ROS must be
  /// up, and nobody have asked for the time yet.
  ClockGate();
  ~ClockGate() { spinner_.stop(); }
  ClockGate(const ClockGate&) = delete;
  ClockGate& operator=(const ClockGate&) = delete;

 private:
  void onClock(const rosgraph_msgs::Clock::ConstPtr& message);

  FaultCount bad_times_;
  ros::CallbackQueue queue_;
  ros::Subscriber subscriber_;
  ros::AsyncSpinner spinner_;
};

}  // namespace helix_arm::ros_bridge
