// When the cockpit stops repeating its target.
#include <gtest/gtest.h>

#include "ros_bridge/cockpit/cockpit_link.hpp"

namespace helix_arm::ros_bridge {
namespace {

class HeldGoalTest : public ::testing::Test {
 protected:
  void SetUp() override { goal_.holdPressures(10.0, {1e5, 0, 0}); }
  HeldGoal goal_;
};

TEST_F(HeldGoalTest, IsRepeatedWhileSomebodyLooks) {
  for (double now = 10.0; now < 60.0; now += 0.1) {
    goal_.look(now);
    ASSERT_TRUE(goal_.turn(now)) << now;
    goal_.noteAnswer(now, false, "", "reached");
  }
  EXPECT_EQ(goal_.pressures(), (std::vector<double>{1e5, 0, 0}));
}

TEST_F(HeldGoalTest, EndsWhereTheWindowHangs) {
  EXPECT_TRUE(goal_.turn(10.0 + HeldGoal::kBlind - 0.01));
  EXPECT_FALSE(goal_.turn(10.0 + HeldGoal::kBlind + 0.01));
  goal_.look(20.0);
  EXPECT_FALSE(goal_.turn(20.0)) << "it begins again by itself";
  EXPECT_NE(goal_.answer().find("window"), std::string::npos);
}

TEST_F(HeldGoalTest, EndsWithTheArmAndDoesNotEnableItAgain) {
  goal_.noteState(true, "enabled: follows targets");
  EXPECT_TRUE(goal_.turn(10.1));
  goal_.noteState(false, "fault: a leak");
  EXPECT_FALSE(goal_.turn(10.2));
  EXPECT_NE(goal_.answer().find("a leak"), std::string::npos);
  goal_.noteState(true, "enabled: follows targets");
  EXPECT_FALSE(goal_.turn(10.3));
}

TEST_F(HeldGoalTest, EndsWhereATargetIsRefusedForGood) {
  goal_.noteAnswer(10.1, true, "out_of_range", "stay within 0 to 400000 Pa");
  EXPECT_FALSE(goal_.turn(10.2));
  EXPECT_TRUE(goal_.refused());
  EXPECT_EQ(goal_.answer(), "stay within 0 to 400000 Pa");
}

TEST_F(HeldGoalTest, ATargetOutOfReachIsHeldAndTold) {
  goal_.noteAnswer(10.1, false, "", "the tip stays 4.1 mm away");
  goal_.noteShort();
  EXPECT_TRUE(goal_.turn(10.2));
  EXPECT_TRUE(goal_.shortOf());
  goal_.noteAnswer(10.3, false, "", "reached");
  EXPECT_FALSE(goal_.shortOf());
}

TEST_F(HeldGoalTest, ATargetThatCameLateIsRepeated) {
  goal_.noteAnswer(10.1, true, "stale", "the target is stamped 2 s ago");
  EXPECT_TRUE(goal_.turn(10.2));
}

TEST_F(HeldGoalTest, WaitsForAnotherCommanderButNotForever) {
  for (double now = 10.0; now < 10.0 + HeldGoal::kPatience; now += 0.1) {
    goal_.look(now);
    ASSERT_TRUE(goal_.turn(now)) << now;
    goal_.noteAnswer(now, true, "other_commander", "/pressure_series commands the arm");
  }
  goal_.look(15.2);
  EXPECT_FALSE(goal_.turn(15.2));
  EXPECT_NE(goal_.answer().find("/pressure_series"), std::string::npos);
}

// As of a visual_servo that died between the cockpit and pressure_command.
TEST_F(HeldGoalTest, EndsWhereNothingAnswers) {
  goal_.noteAnswer(11.0, false, "", "reached");
  const auto turnAt = [this](double now) {
    goal_.look(now);
    return goal_.turn(now);
  };
  EXPECT_TRUE(turnAt(11.0 + HeldGoal::kUnanswered - 0.01));
  goal_.holdPressures(11.0 + HeldGoal::kUnanswered - 0.01, {2e5, 0, 0});
  EXPECT_FALSE(turnAt(11.0 + HeldGoal::kUnanswered + 0.01)) << "another number is no answer";
  EXPECT_NE(goal_.answer().find("nothing answers"), std::string::npos) << goal_.answer();
  EXPECT_TRUE(goal_.refused());
  goal_.holdTip(20.0, {0.3, 0, 0});
  EXPECT_TRUE(turnAt(20.0 + HeldGoal::kUnanswered - 0.01)) << "it has its own time";
}

TEST_F(HeldGoalTest, OnceAcceptedItWaitsAnew) {
  goal_.noteAnswer(10.0, true, "other_commander", "x");
  goal_.noteAnswer(14.0, false, "", "reached");
  goal_.noteAnswer(14.1, true, "other_commander", "x");
  goal_.look(18.0);
  EXPECT_TRUE(goal_.turn(18.0));
}

TEST_F(HeldGoalTest, AnAnswerThatComesAfterItsEndChangesNothing) {
  goal_.end("let go");
  goal_.noteAnswer(10.1, true, "not_enabled", "the arm is vented");
  EXPECT_EQ(goal_.answer(), "let go");
  EXPECT_FALSE(goal_.refused());
}

TEST_F(HeldGoalTest, ATipReplacesPressures) {
  goal_.holdTip(11.0, {0.3, 0.1, 0.0});
  EXPECT_EQ(goal_.goal(), CockpitGoal::kTip);
  EXPECT_EQ(goal_.tip()[1], 0.1);
  EXPECT_TRUE(goal_.turn(11.1));
}

}  // namespace
}  // namespace helix_arm::ros_bridge
