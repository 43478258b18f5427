#include <cmath>

#include <gtest/gtest.h>

#include "ros_bridge/follow/path_goal.hpp"

namespace helix_arm::ros_bridge {
namespace {

using follow::LoopState;
using Result = FollowTipPathResult;

constexpr double kEnd = 4.0;    // of the path [s]
constexpr double kSpeed = 0.1;  // along x [m/s]

// The tip is wanted at kSpeed * path_time on x, and predicted `predicted_off` beside it.
follow::Turn turnAt(double path_time, LoopState state = LoopState::kClosed,
                    double predicted_off = 0.0) {
  follow::Turn out;
  out.state = state;
  out.commands = true;
  out.path_time = path_time;
  out.wanted.translation.x() = kSpeed * std::min(path_time, kEnd);
  out.predicted = out.wanted;
  out.predicted->translation.y() = predicted_off;
  return out;
}

class GoalWatchTest : public ::testing::Test {
 protected:
  // The path begins at 100 s; turns of 10 ms up to a time of the path.
  std::optional<GoalEnding> runTo(double path_time, LoopState state = LoopState::kClosed) {
    for (; path_time_ < path_time; path_time_ += 0.01) {
      if (auto ending = watch_.turn(100 + path_time_, turnAt(path_time_, state))) return ending;
    }
    return std::nullopt;
  }
  // A picture at a time of the path, in which the tip is beside its wanted place.
  std::optional<GoalEnding> see(double path_time, double off) {
    const auto moment = watch_.momentOf(100 + path_time);
    if (!moment) {
      ADD_FAILURE() << "nothing was wanted at " << path_time;
      return std::nullopt;
    }
    const double x = kSpeed * std::min(path_time, kEnd);
    return watch_.picture(*moment, {x, off, 0});
  }

  static GoalRules rules() {
    GoalRules out;
    out.path_tolerance = 0.005;
    out.require_vision = true;
    return out;
  }
  GoalWatch watch_{rules(), kEnd};
  double path_time_ = -1.0;
};

TEST_F(GoalWatchTest, APictureIsComparedWithWhatWasWantedAtItsTime) {
  ASSERT_FALSE(runTo(2.0));
  const auto moment = watch_.momentOf(101.234);  // between two turns
  ASSERT_TRUE(moment);
  EXPECT_NEAR(moment->path_time, 1.234, 1e-9);
  EXPECT_NEAR(moment->wanted.translation.x(), 0.1234, 1e-9);
  EXPECT_EQ(moment->state, LoopState::kClosed);
  EXPECT_FALSE(watch_.momentOf(98.9)) << "before the first turn";
}

TEST_F(GoalWatchTest, FiguresExcludeTheApproachToThePath) {
  ASSERT_FALSE(runTo(0.0));
  EXPECT_FALSE(see(-0.5, 0.05)) << "no tolerance on the way to the first point";
  EXPECT_EQ(watch_.figures().pictures, 0U);
  EXPECT_TRUE(std::isnan(watch_.figures().rms));
  ASSERT_FALSE(runTo(2.1));
  EXPECT_FALSE(see(1.0, 0.001));
  EXPECT_FALSE(see(2.0, 0.003));
  EXPECT_EQ(watch_.figures().pictures, 2U);
  EXPECT_NEAR(watch_.figures().rms, std::sqrt((1e-6 + 9e-6) / 2), 1e-12);
  EXPECT_NEAR(watch_.figures().max, 0.003, 1e-12);
}

TEST_F(GoalWatchTest, BeyondThePathToleranceItIsViolated) {
  ASSERT_FALSE(runTo(2.0));
  EXPECT_FALSE(see(1.0, 0.00499));
  const auto ending = see(1.0, 0.00501);
  ASSERT_TRUE(ending);
  EXPECT_EQ(ending->code, Result::PATH_TOLERANCE_VIOLATED);
  for (const char* words : {"5.01 mm", "1.00 s", "path_tolerance is 5 mm"}) {
    EXPECT_NE(ending->message.find(words), std::string::npos) << ending->message;
  }
}

TEST_F(GoalWatchTest, ItIsReachedByAPictureAfterItsEndWithinTheGoalTolerance) {
  ASSERT_FALSE(runTo(kEnd + 0.5));
  EXPECT_FALSE(see(kEnd - 0.1, 0.0)) << "the path is still under way";
  EXPECT_FALSE(see(kEnd + 0.1, 0.00201));
  const auto ending = see(kEnd + 0.2, 0.00199);
  ASSERT_TRUE(ending);
  EXPECT_EQ(ending->code, Result::SUCCESSFUL);
}

TEST_F(GoalWatchTest, ArrivingTooLateViolatesTheGoalTolerance) {
  ASSERT_FALSE(runTo(kEnd + 1.99));
  EXPECT_FALSE(see(kEnd + 1.9, 0.004));
  const auto ending = runTo(kEnd + 2.02);
  ASSERT_TRUE(ending);
  EXPECT_EQ(ending->code, Result::GOAL_TOLERANCE_VIOLATED);
  for (const char* words : {"4.00 mm", "goal_tolerance is 2 mm"}) {
    EXPECT_NE(ending->message.find(words), std::string::npos) << ending->message;
  }
}

TEST_F(GoalWatchTest, AnEndThatIsNotSeenIsJudgedByThePrediction) {
  for (const double off : {0.0019, 0.0021}) {
    GoalWatch watch({}, kEnd);
    const auto ending = watch.turn(200, turnAt(kEnd + 2.01, LoopState::kOpen, off));
    ASSERT_TRUE(ending) << off;
    EXPECT_EQ(ending->code, off < 0.002 ? Result::SUCCESSFUL : Result::GOAL_TOLERANCE_VIOLATED);
    EXPECT_NE(ending->message.find("not seen"), std::string::npos) << ending->message;
  }
}

TEST_F(GoalWatchTest, VisionThatIsRequiredMayComeLateAndNotGo) {
  EXPECT_FALSE(runTo(1.95, LoopState::kOpen)) << "the first picture is waited for";
  EXPECT_FALSE(runTo(2.5, LoopState::kClosed));
  EXPECT_FALSE(runTo(3.0, LoopState::kCoasting));
  const auto ending = runTo(3.1, LoopState::kOpen);
  ASSERT_TRUE(ending);
  EXPECT_EQ(ending->code, Result::VISION_LOST);
}

TEST_F(GoalWatchTest, VisionThatNeverComesIsLostAfterATimeout) {
  EXPECT_FALSE(runTo(1.98, LoopState::kOpen));
  const auto ending = runTo(2.05, LoopState::kOpen);
  ASSERT_TRUE(ending);
  EXPECT_EQ(ending->code, Result::VISION_LOST);
  GoalWatch any({}, kEnd);
  for (const double path_time : {-1.0, 3.9}) {
    EXPECT_FALSE(any.turn(100 + path_time, turnAt(path_time, LoopState::kOpen)));
  }
}

// The state of a loop that diverges does not tell whether the arm is seen.
TEST_F(GoalWatchTest, VisionThatIsRequiredMayNotGoWhereTheLoopDivergesEither) {
  const auto divergeTo = [this](double end, bool sees) {
    for (; path_time_ < end; path_time_ += 0.01) {
      const double time = 100 + path_time_;
      if (auto ending = watch_.turn(time, turnAt(-0.5, LoopState::kDiverging))) return ending;
      if (sees) watch_.picture(*watch_.momentOf(time), {0.1, 0, 0});
    }
    return std::optional<GoalEnding>();
  };
  ASSERT_FALSE(runTo(1.0));
  EXPECT_FALSE(divergeTo(10.0, true)) << "it is seen";
  EXPECT_FALSE(divergeTo(12.9, false));
  const auto ending = divergeTo(13.1, false);
  ASSERT_TRUE(ending);
  EXPECT_EQ(ending->code, Result::VISION_LOST);
}

// Nobody would see that the arm is free: the path would stand still without end.
TEST_F(GoalWatchTest, APathThatAContactHoldsEndsWhereTheArmIsNoLongerSeen) {
  for (const bool required : {false, true}) {
    GoalRules rules;
    rules.require_vision = required;
    GoalWatch watch(rules, kEnd);
    const auto turn = [&](double time, LoopState state, bool held) {
      follow::Turn next = turnAt(1.0, state);
      next.held = held;
      return watch.turn(time, next);
    };
    ASSERT_FALSE(turn(100, LoopState::kClosed, false));
    ASSERT_FALSE(turn(101, LoopState::kYielding, true));
    ASSERT_FALSE(turn(500, LoopState::kYielding, true)) << "it is seen";
    ASSERT_FALSE(turn(501, LoopState::kCoasting, true));
    const auto ending = turn(504, LoopState::kOpen, true);
    ASSERT_TRUE(ending);
    EXPECT_EQ(ending->code, Result::VISION_LOST);
    for (const char* words : {"contact", "camera", "vision_status"}) {
      EXPECT_NE(ending->message.find(words), std::string::npos) << ending->message;
    }
  }
}

TEST_F(GoalWatchTest, VisionThatIsRequiredIsLostWhereItIsDoubtful) {
  ASSERT_FALSE(runTo(1.0));
  GoalWatch any({}, kEnd);
  EXPECT_FALSE(any.turn(101, turnAt(1.0, LoopState::kDoubtful)));
  const auto ending = watch_.turn(101, turnAt(1.0, LoopState::kDoubtful));
  ASSERT_TRUE(ending);
  EXPECT_EQ(ending->code, Result::VISION_LOST);
  EXPECT_NE(ending->message.find("~reset"), std::string::npos) << ending->message;
}

TEST_F(GoalWatchTest, APathThatTheLoopGivesUpEndsInContact) {
  ASSERT_FALSE(runTo(1.0));
  follow::Turn held = turnAt(1.0, LoopState::kYielding);
  held.path_time.reset();
  const auto ending = watch_.turn(101, held);
  ASSERT_TRUE(ending);
  EXPECT_EQ(ending->code, Result::CONTACT);
}

TEST_F(GoalWatchTest, AJumpBackInTimeForgetsWhatWasWanted) {
  ASSERT_FALSE(runTo(1.0));
  ASSERT_FALSE(watch_.turn(50, turnAt(1.0)));
  EXPECT_TRUE(watch_.momentOf(50.0));
  EXPECT_FALSE(watch_.momentOf(49.9));
  EXPECT_NEAR(watch_.momentOf(200.0)->path_time, 1.0, 1e-12) << "the last one";
}

}  // namespace
}  // namespace helix_arm::ros_bridge
