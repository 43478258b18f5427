#include "ros_bridge/common/conversions.hpp"

#include <gtest/gtest.h>

#include "helix_arm/SafetyState.h"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/model/curve.hpp"
#include "support/has.hpp"
#include "support/linked_arm.hpp"
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

// Two sections of three pieces, none like another.
model::Shape unevenShape() {
  model::Shape::Pieces pieces(6, 6);
  for (int j = 0; j < 6; ++j) {
    for (int i = 0; i < 6; ++i) pieces(i, j) = i == 0 ? 0.14 + 0.01 * j : 0.03 * i - 0.02 * j;
  }
  return {pieces, 3};
}

TEST(Conversions, ALoadedShapeSurvivesTheRoundTrip) {
  const model::Shape shape = unevenShape();
  const statics::TierChoice choice{{statics::Tier::kLoaded, 5}, 1e-4, "the arm's weight bends it"};
  const ArmShape msg = toShapeMsg({}, choice, shape);
  EXPECT_EQ(msg.tier, "loaded");
  EXPECT_EQ(msg.order, 5U);
  EXPECT_EQ(msg.tier_reason, choice.reason);
  EXPECT_EQ(msg.sections, 2U);
  EXPECT_EQ(msg.pieces, 3U);
  ASSERT_EQ(msg.twist.size(), 12U);
  ASSERT_EQ(msg.piece_twist.size(), 36U);
  for (int k = 0; k < 2; ++k) {
    for (int i = 0; i < 6; ++i) {
      double sum = 0;
      for (int j = 3 * k; j < 3 * k + 3; ++j) {
        EXPECT_EQ(msg.piece_twist[6 * j + i], shape.pieces()(i, j));
        sum += shape.pieces()(i, j);
      }
      EXPECT_NEAR(msg.twist[6 * k + i], sum, 1e-15);
    }
  }
  lie::SE3 X;
  for (int j = 0; j < 6; ++j) X = X * lie::SE3::exp(shape.pieces().col(j));
  EXPECT_LT((fromMsg(msg.tip).translation - X.translation).norm(), 1e-15);

  const auto checked = fromMsg(msg, test::sampleArm(2), "arm_base");
  ASSERT_TRUE(std::holds_alternative<model::Shape>(checked));
  EXPECT_EQ(std::get<model::Shape>(checked).pieces(), shape.pieces());
  EXPECT_EQ(std::get<model::Shape>(checked).piecesPerSection(), 3);
}

TEST(Conversions, AShapeIsReadWithTheLinksOfItsArm) {
  const model::Arm arm = test::linkedArm();
  const model::Shape shape = model::shapeOf(arm, arm.twists(arm.inputAt(0.4)));
  const ArmShape msg = toShapeMsg({}, "linear", shape);
  EXPECT_LT((fromMsg(msg.tip).translation - arm.tip(arm.inputAt(0.4)).translation).norm(), 1e-14);
  const auto checked = fromMsg(msg, arm, "arm_base");
  ASSERT_TRUE(std::holds_alternative<model::Shape>(checked));
  const lie::SE3 tip = model::tipPose(std::get<model::Shape>(checked));
  EXPECT_LT((tip.translation - model::tipPose(shape).translation).norm(), 1e-14);
}

TEST(Conversions, PiecesThatMakeNoShapeAreRefused) {
  using control::Fault;
  const struct {
    void (*spoil)(ArmShape& msg);
    Fault fault;
    const char* part;
  } kRows[] = {
      {[](ArmShape& m) { m.pieces = 65; }, Fault::kOutOfRange, "send at most 64"},
      {[](ArmShape& m) { m.piece_twist.pop_back(); }, Fault::kWrongSize, "35 numbers in piece_t"},
      {[](ArmShape& m) { m.pieces = 0; }, Fault::kWrongSize, "36 numbers in piece_twist"},
      {[](ArmShape& m) { m.piece_twist[7] = NAN; }, Fault::kNotFinite, "piece_twist[7] is nan"},
      {[](ArmShape& m) { m.twist[3] += 0.01; }, Fault::kOutOfRange, "do not sum to the twists of"},
  };
  for (const auto& row : kRows) {
    ArmShape msg = toShapeMsg({}, "loaded", unevenShape());
    row.spoil(msg);
    const auto refusal = std::get<control::Refusal>(fromMsg(msg, test::sampleArm(2), "arm_base"));
    EXPECT_EQ(refusal.fault, row.fault) << refusal.message;
    EXPECT_TRUE(test::has(refusal.message, row.part));
  }
}

TEST(Conversions, TheOrientationOfAPositionTargetIsNotLookedAt) {
  TipTarget target;
  target.mode = TipTarget::POSITION;
  target.pose.orientation.x = std::nan("");
  EXPECT_TRUE(std::holds_alternative<TipGoal>(fromMsg(target, "arm_base")));
  target.mode = TipTarget::POSE;
  EXPECT_EQ(std::get<control::Refusal>(fromMsg(target, "arm_base")).fault,
            control::Fault::kNotFinite);
  target.pose.orientation.x = 0;
  EXPECT_EQ(std::get<control::Refusal>(fromMsg(target, "arm_base")).fault,
            control::Fault::kNotUnitQuaternion);
}

geometry_msgs::WrenchStamped wrenchOf(const Eigen::Vector3d& force) {
  geometry_msgs::WrenchStamped out;
  out.wrench.force.x = force.x();
  out.wrench.force.y = force.y();
  out.wrench.force.z = force.z();
  return out;
}

TEST(Conversions, AForceAtTheTipIsTakenUpToItsLimit) {
  for (const Eigen::Vector3d& force :
       {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(0.1, -0.2, 0.3), Eigen::Vector3d(60, 0, -80)}) {
    for (const char* frame : {"", "arm_base"}) {
      geometry_msgs::WrenchStamped wrench = wrenchOf(force);
      wrench.header.frame_id = frame;
      EXPECT_EQ(std::get<Eigen::Vector3d>(fromMsg(wrench, "arm_base")), force);
    }
  }
  for (const Eigen::Vector3d& force :
       {Eigen::Vector3d(60, 0, 80.1), Eigen::Vector3d(0, std::nan(""), 0)}) {
    EXPECT_TRUE(std::holds_alternative<control::Refusal>(fromMsg(wrenchOf(force), "arm_base")));
  }
}

TEST(Conversions, TheConstantsOfSafetyStateAreTheNamesOfTheStates) {
  using Message = helix_arm::SafetyState;
  EXPECT_EQ(Message::DISABLED, control::nameOf(control::SafetyState::kDisabled));
  EXPECT_EQ(Message::ENABLED, control::nameOf(control::SafetyState::kEnabled));
  EXPECT_EQ(Message::FAULT, control::nameOf(control::SafetyState::kFault));
  EXPECT_EQ(Message::VENTED, control::nameOf(control::SafetyState::kVented));
}

}  // namespace
}  // namespace helix_arm::ros_bridge
