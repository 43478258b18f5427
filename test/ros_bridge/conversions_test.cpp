#include "helix_arm/ros_bridge/conversions.hpp"

#include <cmath>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "support/sample_arm.hpp"

namespace helix_arm::ros_bridge {
namespace {

TEST(Conversions, PosesSurviveTheRoundTrip) {
  for (int i = 0; i < 200; ++i) {
    const lie::Vector6 xi = 3.0 * lie::Vector6::Random();
    const lie::SE3 X = lie::SE3::exp(xi), back = fromMsg(toPoseMsg(X));
    EXPECT_EQ(back.translation, X.translation);
    EXPECT_LT((back.rotation - X.rotation).norm(), 1e-14);
  }
}

// A quarter turn about z takes x to y: (0, 0, sin 45, cos 45) in the message's order x, y, z, w.
TEST(Conversions, QuaternionsAreInTheOrderOfTheMessage) {
  const lie::SE3 X = lie::SE3::exp((lie::Vector6() << 0, 0, 0, 0, 0, M_PI / 2).finished());
  const auto q = toQuaternionMsg(X.rotation);
  EXPECT_NEAR(q.x, 0.0, 1e-15);
  EXPECT_NEAR(q.y, 0.0, 1e-15);
  EXPECT_NEAR(q.z, std::sqrt(0.5), 1e-15);
  EXPECT_NEAR(q.w, std::sqrt(0.5), 1e-15);
  EXPECT_EQ(toTransformMsg(X).rotation, q);
}

TEST(Conversions, AShapeIsWrittenSectionBySection) {
  const model::Arm arm = test::sampleArm(2);
  const Eigen::VectorXd q = (Eigen::VectorXd(6) << 1e5, 0, 0, 0, 2e5, 0).finished();
  const model::Twists twists = arm.twists(q);
  const ArmShape msg = toShapeMsg({}, "linear", twists);
  EXPECT_EQ(msg.sections, 2U);
  ASSERT_EQ(msg.twist.size(), 12U);
  for (int k = 0; k < 2; ++k) {
    for (int i = 0; i < 6; ++i) EXPECT_EQ(msg.twist[6 * k + i], twists(i, k));
  }
  EXPECT_LT((fromMsg(msg.tip).translation - arm.tip(q).translation).norm(), 1e-15);

  ShapeTarget same;
  same.twist = msg.twist;
  EXPECT_EQ(std::get<model::Twists>(fromMsg(same, 2)), twists);
}

TEST(Conversions, PressuresAreNamed) {
  const model::Arm arm = test::sampleArm();
  const PressureArray msg = toPressureMsg({}, arm, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(msg.name, (std::vector<std::string>{"s1_m1", "s1_m2", "s1_m3"}));
  EXPECT_EQ(msg.pressure, (std::vector<double>{1, 2, 3}));
  EXPECT_EQ(std::get<Eigen::VectorXd>(fromMsg(msg, arm, Eigen::Vector3d::Zero())),
            Eigen::Vector3d(1, 2, 3));
}

TEST(Conversions, OnlyTheBaseFrameIsTaken) {
  TipTarget target;
  for (const char* frame : {"", "left_arm_base"}) {
    target.header.frame_id = frame;
    EXPECT_TRUE(std::holds_alternative<TipGoal>(fromMsg(target, "left_arm_base"))) << frame;
  }
  for (const char* frame : {"world", "arm_base", "/left_arm_base"}) {
    target.header.frame_id = frame;
    const auto checked = fromMsg(target, "left_arm_base");
    ASSERT_TRUE(std::holds_alternative<control::Refusal>(checked)) << frame;
    EXPECT_EQ(std::get<control::Refusal>(checked).fault, control::Fault::kWrongFrame);
  }
}

TEST(Conversions, TheOrientationOfAPositionTargetIsNotLookedAt) {
  TipTarget target;
  target.mode = TipTarget::POSITION;
  target.pose.orientation.x = std::nan("");
  EXPECT_TRUE(std::holds_alternative<TipGoal>(fromMsg(target, "arm_base")));
  target.mode = TipTarget::POSE;
  EXPECT_TRUE(std::holds_alternative<control::Refusal>(fromMsg(target, "arm_base")));
}

}  // namespace
}  // namespace helix_arm::ros_bridge
