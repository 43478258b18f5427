#pragma once

#include <string>

#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>
#include <ros/time.h>
#include <rosgraph_msgs/Clock.h>

#include "diagnostics.hpp"

namespace helix_arm::ros_bridge {

/// ROS time while it advances. If it stops, for example because the node that simulates it has
/// ended, a steady clock continues it, so that earlier data still ages.
///
/// Call now() more often than every kPatience.
class MovingClock {
 public:
  static constexpr double kPatience = 2.0;  ///< longest stop of ROS time [s]

  /// [s]
  double now();
  /// Whether ROS time had stopped at the last call of now().
  bool stands() const { return stands_; }

 private:
  ros::Time last_;
  ros::SteadyTime since_;  ///< when ROS time last changed
  bool stands_ = false;
};

/// Sets a process's simulated time from /clock, ignoring times that ROS cannot compute with.
///
/// roscpp accepts any time. Sums and differences of times throw if they exceed 32 bits, also in
/// threads of roscpp and actionlib where the exception cannot be caught: one message would end the
/// process. Times of 2^31 s and more, or with 10^9 ns or more, are dropped, counted and warned of.
/// No effect without /use_sim_time.
class ClockGate {
 public:
  /// Calls ros::init() such that roscpp neither reads /use_sim_time nor subscribes to /clock.
  static void init(int argc, char** argv, const std::string& name);

  /// Whether ROS can compute with a time: it is below 2^31 s, with less than 10^9 ns.
  static bool isSound(const ros::Time& time);

  /// Starts setting the time, in its own thread, if /use_sim_time is set. ROS must be up, and the
  /// time must not have been read yet.
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
