// Two rigs with two loops on one master, launched by two_arms.launch: each follows its own targets.
#include <cmath>
#include <map>
#include <set>

#include <tf2_msgs/TFMessage.h>

#include "helix_arm/LoopStatus.h"
#include "helix_arm/SafetyState.h"
#include "ros_bridge/common/conversions.hpp"
#include "support/ros_rig.hpp"

namespace helix_arm::test {
namespace {

const Eigen::Vector3d kMiddle(0.366, 0.0035, 0.0088);  // of what the arm reaches, base frame [m]
constexpr double kDeadline = 120;                      // two cameras are rendered in real time [s]

struct Arm {
  explicit Arm(const std::string& ns)
      : node(ns),
        tip_target(node.advertise<TipTarget>(names::kTipTarget, 10)),
        loop(node, names::kVisualServoStatus),
        measured(node, names::kMeasured),
        safety(node, names::kSafetyState) {}

  void aim(const Eigen::Vector3d& position) {
    TipTarget target;
    target.header.stamp = ros::Time::now();
    target.mode = TipTarget::POSITION;
    target.pose.position = ros_bridge::toPointMsg(position);
    tip_target.publish(target);
  }
  bool isClosed() const { return !loop.all().empty() && loop.last().state == LoopStatus::CLOSED; }
  double distance(const Eigen::Vector3d& position) const {
    if (measured.all().empty()) return INFINITY;
    return (ros_bridge::fromMsg(measured.last().tip).translation - position).norm();
  }

  ros::NodeHandle node;
  ros::Publisher tip_target;
  Inbox<LoopStatus> loop;
  Inbox<ArmShape> measured;
  Inbox<SafetyState> safety;
};

class TwoArms : public ::testing::Test {
 protected:
  // Whether the condition comes to hold while both targets are repeated at 20 Hz.
  bool comes(const Eigen::Vector3d& left, const Eigen::Vector3d& right,
             const std::function<bool()>& condition) {
    ros::SteadyTime last;
    return waitFor(
        [&] {
          const ros::SteadyTime now = ros::SteadyTime::now();
          if (now - last > ros::WallDuration(0.05)) {
            last = now;
            left_.aim(left);
            right_.aim(right);
          }
          return condition();
        },
        kDeadline);
  }

  Arm left_{"left"}, right_{"right"};
  ros::NodeHandle node_;
  Inbox<tf2_msgs::TFMessage> tf_{node_, names::kTf}, static_tf_{node_, names::kStaticTf};
};

TEST_F(TwoArms, EachLoopClosesAndBringsItsOwnTipToItsOwnTarget) {
  const Eigen::Vector3d left = kMiddle + Eigen::Vector3d(0, 0.02, 0);
  const Eigen::Vector3d right = kMiddle - Eigen::Vector3d(0, 0.02, 0);
  ASSERT_TRUE(waitFor(
      [this] {
        return left_.tip_target.getNumSubscribers() > 0 &&
               right_.tip_target.getNumSubscribers() > 0 && !left_.measured.all().empty() &&
               !right_.measured.all().empty();
      },
      kDeadline));
  ASSERT_TRUE(comes(left, right, [this] { return left_.isClosed() && right_.isClosed(); }))
      << left_.loop.last().message << "\n"
      << right_.loop.last().message;
  EXPECT_TRUE(comes(left, right,
                    [&] { return left_.distance(left) < 0.005 && right_.distance(right) < 0.005; }))
      << left_.distance(left) << " " << right_.distance(right);
  EXPECT_GT(left_.distance(right), 0.02) << "the arms are not told apart";
}

TEST_F(TwoArms, FramesHaveAPrefixAndOneParentEach) {
  std::map<std::string, std::set<std::string>> parents;
  const auto collect = [&] {
    for (const auto* inbox : {&tf_, &static_tf_}) {
      for (const auto& message : inbox->all()) {
        for (const auto& t : message->transforms) {
          parents[t.child_frame_id].insert(t.header.frame_id);
        }
      }
    }
    return parents.count("left_model_tip") > 0 && parents.count("right_measured_tip") > 0 &&
           parents.count("left_arm_base") > 0 && parents.count("right_camera_optical") > 0 &&
           parents.count("right_world") > 0;
  };
  ASSERT_TRUE(waitFor(collect, kDeadline));
  for (const auto& [child, of_child] : parents) {
    EXPECT_EQ(of_child.size(), 1U) << child;
    EXPECT_TRUE(child.rfind("left_", 0) == 0 || child.rfind("right_", 0) == 0) << child;
  }
  EXPECT_EQ(*parents["left_arm_base"].begin(), "left_world");
  EXPECT_EQ(*parents["left_world"].begin(), "world");
}

TEST_F(TwoArms, AVentOfOneLeavesTheOtherEnabled) {
  ASSERT_TRUE(waitFor(
      [this] { return !left_.safety.all().empty() && !right_.safety.all().empty(); }, kDeadline));
  ASSERT_TRUE(comes(kMiddle, kMiddle, [this] {
    return left_.safety.last().state == SafetyState::ENABLED &&
           right_.safety.last().state == SafetyState::ENABLED;
  }));
  std_srvs::Trigger vent;
  ASSERT_TRUE(ros::service::call("left/pressure_command/vent", vent));
  ASSERT_TRUE(
      comes(kMiddle, kMiddle, [this] { return left_.safety.last().state == SafetyState::VENTED; }));
  EXPECT_EQ(right_.safety.last().state, SafetyState::ENABLED);
}

}  // namespace
}  // namespace helix_arm::test
