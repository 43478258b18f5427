// Goals of the tip: how they are checked and watched, and what the loop is told of tags.
#include "ros_bridge/follow/path_goal.hpp"

#include <stdexcept>

#include <gtest/gtest.h>

#include "ros_bridge/follow/loop_reports.hpp"
#include "support/eventually.hpp"
#include "support/has.hpp"

namespace helix_arm::ros_bridge {
namespace {

using test::eventually;
using Result = FollowTipPathResult;
using follow::LoopState;
using Indices = std::vector<int>;

// Checks that last until they may end, and what ran of them.
struct Checks {
  std::atomic<bool> may_end = false, heed_stop = true;
  std::atomic<int> begun = 0, running = 0, most = 0, stopped = 0;

  PathChecker::Check make(std::string result) {
    return [this, result = std::move(result)](const std::atomic<bool>& stop) {
      ++begun;
      const int now = ++running;
      for (int seen = most; now > seen && !most.compare_exchange_weak(seen, now);) {
      }
      while (!may_end && !(heed_stop && stop)) std::this_thread::yield();
      if (stop) ++stopped;
      --running;
      return GoalEnding{Result::INVALID_GOAL, result};
    };
  }
};

// That a goal has ended so, and which words tell it.
void expectEnding(const std::optional<GoalEnding>& ending, std::int32_t code,
                  const std::vector<const char*>& words = {}) {
  ASSERT_TRUE(ending);
  EXPECT_EQ(ending->code, code) << ending->message;
  for (const char* word : words) EXPECT_TRUE(test::has(ending->message, word));
}

std::string messageOf(const DecidedGoal& decided) {
  const auto* refusal = std::get_if<GoalEnding>(&decided);
  return refusal == nullptr ? "" : refusal->message;
}

// The message of its result, once it has come.
std::string resultOf(PathChecker& checker) {
  std::optional<DecidedGoal> out;
  eventually([&] { return (out = checker.take()).has_value(); });
  return out ? messageOf(*out) : "no result";
}

TEST(PathChecker, WhatACheckThrowsIsItsResult) {
  PathChecker checker;
  checker.begin([](const std::atomic<bool>&) -> DecidedGoal {
    throw std::runtime_error("no shape holds the load");
  });
  EXPECT_EQ(resultOf(checker), "no shape holds the load");
}

TEST(PathChecker, AFloodOfChecksHasTwoThreadsAndTheLastOneIsAnswered) {
  Checks checks;
  checks.heed_stop = false;  // the worst of checks
  PathChecker checker;
  for (int k = 0; k < 1000; ++k) {
    checker.begin(checks.make(std::to_string(k)));
    EXPECT_FALSE(checker.take());
  }
  ASSERT_TRUE(eventually([&] { return checks.begun == 2; }));
  for (int k = 0; k < 1000; ++k) EXPECT_FALSE(checker.take());
  EXPECT_EQ(checks.begun, 2) << "the others wait, or have been replaced";
  checks.may_end = true;
  EXPECT_EQ(resultOf(checker), "999");
  EXPECT_EQ(checks.begun, 3);
  EXPECT_EQ(checks.most, static_cast<int>(PathChecker::kMostThreads));
}

TEST(PathChecker, ADiscardedCheckIsToldToStopAndHasNoResult) {
  Checks checks;
  PathChecker checker;
  checker.begin(checks.make("discarded"));
  ASSERT_TRUE(eventually([&] { return checks.running == 1; }));
  checker.discard();
  EXPECT_TRUE(eventually([&] { return checks.stopped == 1; }));
  EXPECT_FALSE(checker.take());
  checks.may_end = true;
  checker.begin(checks.make("next"));
  EXPECT_EQ(resultOf(checker), "next");
}

// A goal of so many points in the frame "wall".
FollowTipPathGoal goalOf(std::size_t points) {
  FollowTipPathGoal goal;
  goal.path.header.frame_id = "wall";
  goal.path.joint_names = {"tip"};
  goal.path.points.resize(points);
  for (std::size_t k = 0; k < points; ++k) {
    auto& point = goal.path.points[k];
    point.transforms.resize(1);
    point.transforms[0].translation.x = 0.1;
    point.time_from_start = ros::Duration(0.01 * static_cast<double>(k));
  }
  goal.path_tolerance = 0.004;
  return goal;
}

TEST(Decide, ConvertsAGoalToTheBaseFrameAndChecksItsPath) {
  const FollowTipPathGoal goal = goalOf(3);
  EXPECT_FALSE(refusalOf(goal, 0.5));
  double tolerance = 0.0;
  const lie::SE3 X_BF{Eigen::Matrix3d::Identity(), {0, 0, 1}};
  const DecidedGoal decided = decide(
      goal, X_BF,
      [&](const control::TipPath&, double given, const std::atomic<bool>&) {
        tolerance = given;
        return std::string();
      },
      false);
  ASSERT_TRUE(std::holds_alternative<PathGoal>(decided)) << messageOf(decided);
  EXPECT_EQ(std::get<PathGoal>(decided).path.at(0.015).position, Eigen::Vector3d(0.1, 0, 1));
  EXPECT_EQ(std::get<PathGoal>(decided).path.lastTime(), 0.02);
  EXPECT_EQ(tolerance, 0.004);
  EXPECT_EQ(messageOf(decide(
                goal, {}, [](auto&&...) { return "too fast"; }, false)),
            "too fast");
}

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

ContactWords contact() { return {"it looks like a contact", "mend that"}; }

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
  GoalWatch watch_{rules(), kEnd, contact};
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
  expectEnding(see(1.0, 0.00501), Result::PATH_TOLERANCE_VIOLATED,
               {"5.01 mm", "1.00 s", "path_tolerance is 5 mm"});
}

TEST_F(GoalWatchTest, ItIsReachedByAPictureAfterItsEndWithinTheGoalTolerance) {
  ASSERT_FALSE(runTo(kEnd + 0.5));
  EXPECT_FALSE(see(kEnd - 0.1, 0.0)) << "the path is still under way";
  EXPECT_FALSE(see(kEnd + 0.1, 0.00201));
  expectEnding(see(kEnd + 0.2, 0.00199), Result::SUCCESSFUL);
}

TEST_F(GoalWatchTest, ArrivingTooLateViolatesTheGoalTolerance) {
  ASSERT_FALSE(runTo(kEnd + 1.99));
  EXPECT_FALSE(see(kEnd + 1.9, 0.004));
  expectEnding(runTo(kEnd + 2.02), Result::GOAL_TOLERANCE_VIOLATED,
               {"4.00 mm", "goal_tolerance is 2 mm"});
}

TEST_F(GoalWatchTest, AnEndThatIsNotSeenIsJudgedByThePrediction) {
  for (const double off : {0.0019, 0.0021}) {
    GoalWatch watch({}, kEnd, contact);
    expectEnding(watch.turn(200, turnAt(kEnd + 2.01, LoopState::kOpen, off)),
                 off < 0.002 ? Result::SUCCESSFUL : Result::GOAL_TOLERANCE_VIOLATED, {"not seen"});
  }
}

TEST_F(GoalWatchTest, VisionThatIsRequiredMayComeLateAndNotGo) {
  EXPECT_FALSE(runTo(1.98, LoopState::kOpen)) << "the first picture is waited for";
  GoalWatch never = watch_, any({}, kEnd, contact);
  expectEnding(never.turn(102.05, turnAt(2.05, LoopState::kOpen)), Result::VISION_LOST);
  for (const double path_time : {-1.0, 3.9}) {
    EXPECT_FALSE(any.turn(100 + path_time, turnAt(path_time, LoopState::kOpen)));
  }
  EXPECT_FALSE(runTo(2.5, LoopState::kClosed));
  EXPECT_FALSE(runTo(3.0, LoopState::kCoasting));
  expectEnding(runTo(3.1, LoopState::kOpen), Result::VISION_LOST);
}

// Nobody would see that the arm is free: the path would stand still without end.
TEST_F(GoalWatchTest, APathThatAContactHoldsEndsWhereTheArmIsNoLongerSeen) {
  for (const bool required : {false, true}) {
    GoalRules rules;
    rules.require_vision = required;
    GoalWatch watch(rules, kEnd, contact);
    const auto turn = [&](double time, LoopState state, bool held) {
      follow::Turn next = turnAt(1.0, state);
      next.held = held;
      return watch.turn(time, next);
    };
    ASSERT_FALSE(turn(100, LoopState::kClosed, false));
    ASSERT_FALSE(turn(101, LoopState::kYielding, true));
    ASSERT_FALSE(turn(500, LoopState::kYielding, true)) << "it is seen";
    ASSERT_FALSE(turn(501, LoopState::kCoasting, true));
    expectEnding(turn(504, LoopState::kOpen, true), Result::VISION_LOST,
                 {"it looks like a contact", "camera", "vision_status", "mend that"});
  }
}

TEST_F(GoalWatchTest, APathThatTheLoopGivesUpEndsInContact) {
  ASSERT_FALSE(runTo(1.0));
  follow::Turn held = turnAt(1.0, LoopState::kYielding);
  held.path_time.reset();
  expectEnding(watch_.turn(101, held), Result::CONTACT,
               {"it looks like a contact, and on_contact is STOP: ", "mend that, and send"});
}

constexpr double kNow = 100.0;  // [s]
constexpr double kMoment = 1e-6;

ros::Time stampOf(int picture) { return ros::Time(50 + picture, 0); }

SeenArm shapeOf(int picture) {
  return {stampOf(picture), model::Shape(model::Twists::Constant(6, 1, picture)),
          Eigen::MatrixXd::Identity(6, 6)};
}

class TagMatching : public testing::Test {
 protected:
  // Its picture, -1 without one.
  int take(double now = kNow) {
    seen = matcher.take(now);
    return seen ? static_cast<int>(seen->stamp.sec) - 50 : -1;
  }

  TagMatcher matcher;
  std::optional<SeenArm> seen;
};

TEST_F(TagMatching, AShapeGetsTheTagsOfItsStampInEitherOrder) {
  matcher.addTags(stampOf(0), Indices{7}, kNow);
  matcher.add(shapeOf(1), kNow);
  EXPECT_EQ(take(), -1) << "its tags may still come";
  matcher.addTags(stampOf(1), Indices{1, 3}, kNow);
  EXPECT_EQ(take(), 1);
  EXPECT_EQ(seen->tags, (Indices{1, 3}));
  EXPECT_EQ(seen->shape.twists()(0, 0), 1);
  matcher.addTags(stampOf(2), Indices{2}, kNow);
  matcher.add(shapeOf(2), kNow);
  EXPECT_EQ(take(), 2);
  EXPECT_EQ(seen->tags, Indices{2});
  EXPECT_EQ(take(), -1);
}

TEST_F(TagMatching, AShapeWaitsForItsTimeOrForLaterTagsAndNoLonger) {
  matcher.addTags(stampOf(0), Indices{7}, kNow);
  matcher.add(shapeOf(1), kNow);
  EXPECT_EQ(take(kNow + TagMatcher::kPatience - kMoment), -1);
  EXPECT_EQ(take(kNow + TagMatcher::kPatience + kMoment), 1);
  EXPECT_FALSE(seen->tags);
  matcher.add(shapeOf(2), kNow);
  EXPECT_EQ(take(), -1);
  matcher.addTags(stampOf(3), Indices{2}, kNow);
  EXPECT_EQ(take(), 2);
  EXPECT_FALSE(seen->tags);
}

TagDetection detection(int id, bool fitted) {
  TagDetection out;
  out.id = id;
  out.fitted = fitted;
  return out;
}

TEST(FittedTags, AreIndicesOfTheLayoutInAscendingOrder) {
  estimation::TagLayout layout;
  for (const int id : {30, 10, 20}) layout.tags.push_back({id, 0, 0.5, {}});
  TagDetections detections;
  EXPECT_FALSE(fittedTags(detections, layout)) << "nothing was fitted";
  detections.tags = {detection(10, true), detection(15, false), detection(20, false),
                     detection(30, true), detection(30, true)};
  EXPECT_EQ(fittedTags(detections, layout), (Indices{0, 1}));
  detections.tags.push_back(detection(40, true));
  EXPECT_FALSE(fittedTags(detections, layout)) << "of another layout";
}

}  // namespace
}  // namespace helix_arm::ros_bridge
