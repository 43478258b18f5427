// The cockpit without its window: what it offers, holds and remembers.
#include "ros_bridge/cockpit/cockpit_link.hpp"
#include "ros_bridge/cockpit/cockpit_view.hpp"
#include "support/has.hpp"

namespace helix_arm::ros_bridge {
namespace {

// What the cockpit says of an arm, and what it offers.
CockpitView arm(const std::string& state) {
  CockpitView out;
  out.ns = "/left";
  out.connected = true;
  out.safety.emplace();
  out.safety->state = state;
  out.channels = {{"muscle_1", 1e5, 99e3, 0, 4e5}};
  return out;
}

TEST(Possibility, WithoutAnArmOnlyTheStopIsOffered) {
  CockpitView view = arm("enabled");
  view.connected = false;
  view.safety->stopped = true;  // of an arm that is gone: latched topics outlive nothing
  EXPECT_TRUE(mayStop(view).possible());
  for (const Possibility& one :
       {mayEnable(view), mayVent(view), mayRelease(view), mayHold(view), mayAimTip(view),
        maySetPressure(view, view.channels[0]), mayUse(view), mayCalibrate(view)}) {
    EXPECT_FALSE(one.possible());
  }
}

Possibility maySlide(const CockpitView& view) { return maySetPressure(view, view.channels[0]); }

TEST(Possibility, FollowsFromTheState) {
  CockpitView view = arm("enabled");
  EXPECT_TRUE(maySlide(view).possible() && mayHold(view).possible() && mayStop(view).possible());
  view.channels[0].upper = kUnknown;
  EXPECT_FALSE(maySlide(view).possible()) << "whose limits are not known";
  view = arm("enabled");
  view.calibration.there = true;
  EXPECT_TRUE(mayCalibrate(view).possible());
  view.goal = CockpitGoal::kPressures;
  EXPECT_FALSE(mayCalibrate(view).possible()) << "the cockpit holds the arm";
  view.goal = CockpitGoal::kNone;
  view.calibration.running = true;
  EXPECT_FALSE(mayCalibrate(view).possible()) << "no second goal";
  EXPECT_TRUE(mayCancel(view).possible());
  EXPECT_FALSE(mayHold(view).possible() || mayAimTip(view).possible() || maySlide(view).possible());
  view = arm("disabled");
  EXPECT_TRUE(mayEnable(view).possible());
  view.channels[0].measured = kUnknown;
  EXPECT_FALSE(mayEnable(view).possible()) << "whose pressure is not known";
  EXPECT_FALSE(mayEnable(arm("fault")).possible());
  view = arm("vented");
  view.safety->stopped = true;
  EXPECT_TRUE(mayRelease(view).possible());
  EXPECT_FALSE(mayEnable(view).possible() || mayHold(view).possible());
  view = arm("fault");
  view.goal = CockpitGoal::kPressures;
  EXPECT_TRUE(mayHold(view).possible()) << "to let go";
}

// When the cockpit stops repeating its target.
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
  EXPECT_EQ(goal_.state().held, (std::vector<double>{1e5, 0, 0}));
}

TEST_F(HeldGoalTest, EndsWhereTheWindowHangs) {
  EXPECT_TRUE(goal_.turn(10.0 + HeldGoal::kBlind - 0.01));
  EXPECT_FALSE(goal_.turn(10.0 + HeldGoal::kBlind + 0.01));
  goal_.look(20.0);
  EXPECT_FALSE(goal_.turn(20.0)) << "it begins again by itself";
  EXPECT_TRUE(test::has(goal_.state().answer, "window"));
}

TEST_F(HeldGoalTest, EndsWithTheArmAndDoesNotEnableItAgain) {
  goal_.noteState(true, "enabled: follows targets");
  EXPECT_TRUE(goal_.turn(10.1));
  goal_.noteState(false, "fault: a leak");
  EXPECT_FALSE(goal_.turn(10.2));
  EXPECT_TRUE(test::has(goal_.state().answer, "a leak"));
  goal_.noteState(true, "enabled: follows targets");
  EXPECT_FALSE(goal_.turn(10.3));
}

TEST_F(HeldGoalTest, EndsWhereATargetIsRefusedForGood) {
  goal_.noteAnswer(10.1, true, "out_of_range", "stay within 0 to 400000 Pa");
  EXPECT_FALSE(goal_.turn(10.2));
  EXPECT_TRUE(goal_.state().refused);
  EXPECT_EQ(goal_.state().answer, "stay within 0 to 400000 Pa");
}

TEST_F(HeldGoalTest, ATargetOutOfReachOrThatCameLateIsHeldAndTold) {
  goal_.noteAnswer(10.1, false, "", "the tip stays 4.1 mm away", true);
  EXPECT_TRUE(goal_.turn(10.2));
  EXPECT_TRUE(goal_.state().short_of);
  goal_.noteAnswer(10.3, false, "", "reached");
  EXPECT_FALSE(goal_.state().short_of);
  goal_.noteAnswer(10.3, true, "stale", "the target is stamped 2 s ago");
  EXPECT_TRUE(goal_.turn(10.4));
}

TEST_F(HeldGoalTest, WaitsForAnotherCommanderButNotForever) {
  for (double now = 10.0; now < 10.0 + HeldGoal::kPatience; now += 0.1) {
    goal_.look(now);
    ASSERT_TRUE(goal_.turn(now)) << now;
    goal_.noteAnswer(now, true, "other_commander", "/pressure_series commands the arm");
  }
  goal_.look(15.2);
  EXPECT_FALSE(goal_.turn(15.2));
  EXPECT_TRUE(test::has(goal_.state().answer, "/pressure_series"));
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
  EXPECT_TRUE(test::has(goal_.state().answer, "nothing answers"));
  EXPECT_TRUE(goal_.state().refused);
  goal_.holdTip(20.0, {0.3, 0, 0});
  EXPECT_TRUE(turnAt(20.0 + HeldGoal::kUnanswered - 0.01)) << "it has its own time";
}

TEST(StripHistory, AxesHoldAllValuesInSteps) {
  StripHistory history(30, 0);
  history.add(1, {1.1e5, 0}, 0.0011);
  EXPECT_EQ(history.pressureTop(1e5), 2e5);
  EXPECT_DOUBLE_EQ(history.errorTop(1e-3), 2e-3);
  history.add(2, {2.1e5, 0}, 0.0051);
  EXPECT_EQ(history.pressureTop(1e5), 5e5);
  EXPECT_DOUBLE_EQ(history.errorTop(1e-3), 1e-2);
}

}  // namespace
}  // namespace helix_arm::ros_bridge
