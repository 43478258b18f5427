#pragma once

#include <string>

#include <ros/node_handle.h>
#include <ros/time.h>

#include "helix_arm/follow/visual_servo.hpp"

namespace helix_arm::ros_bridge {

/// Publishes what the pictures tell of the arm besides its shape: error_budget and external_load.
class LoadPublisher {
 public:
  LoadPublisher(ros::NodeHandle& node, std::string base_frame);

  /// After a picture that the loop used, or a change of the loop itself such as a reset. A budget
  /// of this picture is published at most at 5 Hz; the load on every change, and with every picture
  /// while something touches the arm.
  void publish(const ros::Time& picture, const follow::VisualServo& loop);
  /// After a turn: the load, if its state has changed without a picture, as by a lack of pictures.
  void publishChange(const ros::Time& turn, const follow::VisualServo& loop);

 private:
  void publishBudget(const ros::Time& picture, const estimation::TipErrorBudget& budget,
                     const estimation::Drift& drift);
  void publishLoad(const ros::Time& stamp, const follow::VisualServo& loop);

  const std::string base_frame_;
  ros::Publisher budget_publisher_, load_publisher_;
  ros::Time last_budget_;
  std::string last_state_;  ///< of the load
};

}  // namespace helix_arm::ros_bridge
