#pragma once

#include <atomic>
#include <chrono>
#include <mutex>
#include <string>
#include <thread>

#include <actionlib_msgs/GoalID.h>
#include <actionlib_msgs/GoalStatusArray.h>
#include <ros/node_handle.h>

#include "helix_arm/FollowTipPathAction.h"

namespace helix_arm::test {

/// An action follow_tip_path whose goals run without end: says that the last one is active, with a
/// feedback, ten times a second, from a thread of its own. Its callbacks are of the global queue.
class SilentPathServer {
 public:
  explicit SilentPathServer(const std::string& action)
      : node_(action),
        status_publisher_(node_.advertise<actionlib_msgs::GoalStatusArray>("status", 100)),
        feedback_publisher_(node_.advertise<FollowTipPathActionFeedback>("feedback", 100)),
        result_publisher_(node_.advertise<FollowTipPathActionResult>("result", 100)),
        goal_subscriber_(node_.subscribe("goal", 10, &SilentPathServer::onGoal, this)),
        cancel_subscriber_(node_.subscribe("cancel", 10, &SilentPathServer::onCancel, this)),
        thread_([this] { beat(); }) {}
  ~SilentPathServer() {
    stop_ = true;
    thread_.join();
  }

  /// Whether a goal has come since the last call.
  bool takeGoal() { return new_.exchange(false); }

  actionlib_msgs::GoalStatusArray status() const {
    actionlib_msgs::GoalStatusArray out;
    out.header.stamp = ros::Time::now();
    out.status_list = {goalStatus()};
    return out;
  }
  FollowTipPathActionFeedback feedback() const {
    FollowTipPathActionFeedback out;
    out.header.stamp = ros::Time::now();
    out.status = goalStatus();
    out.feedback.state = "closed";
    return out;
  }
  FollowTipPathActionResult result() const {
    FollowTipPathActionResult out;
    out.header.stamp = ros::Time::now();
    out.status = goalStatus();
    out.status.status = actionlib_msgs::GoalStatus::ABORTED;
    return out;
  }

 private:
  void onGoal(const FollowTipPathActionGoalConstPtr& goal) {
    const std::lock_guard<std::mutex> lock(mutex_);
    goal_ = goal->goal_id;
    new_ = true;
  }
  void onCancel(const actionlib_msgs::GoalIDConstPtr&) {}

  actionlib_msgs::GoalStatus goalStatus() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    actionlib_msgs::GoalStatus out;
    out.goal_id = goal_;
    out.status = actionlib_msgs::GoalStatus::ACTIVE;
    return out;
  }

  void beat() {
    while (!stop_) {
      status_publisher_.publish(status());
      feedback_publisher_.publish(feedback());
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
  }

  ros::NodeHandle node_;
  ros::Publisher status_publisher_, feedback_publisher_, result_publisher_;
  mutable std::mutex mutex_;
  actionlib_msgs::GoalID goal_;
  std::atomic<bool> new_ = false, stop_ = false;
  ros::Subscriber goal_subscriber_, cancel_subscriber_;
  std::thread thread_;
};

}  // namespace helix_arm::test
