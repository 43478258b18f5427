#include <algorithm>
#include <cstring>
#include <stdexcept>
#include <thread>

#include <gtest/gtest.h>

#include "helix_arm/control/tip_path.hpp"
#include "ros_bridge/follow/path_goal.hpp"
#include "support/eventually.hpp"

namespace helix_arm::ros_bridge {
namespace {

using test::eventually;
using Result = FollowTipPathResult;

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

TEST(PathChecker, GivesTheResultOfACheckOnce) {
  Checks checks;
  PathChecker checker;
  checker.begin(checks.make("too far"));
  EXPECT_FALSE(checker.take());
  checks.may_end = true;
  EXPECT_EQ(resultOf(checker), "too far");
  EXPECT_FALSE(checker.take());
  EXPECT_EQ(checks.stopped, 0);
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

TEST(PathChecker, ACheckThatWaitsAndIsDiscardedNeverRuns) {
  Checks checks;
  checks.heed_stop = false;
  PathChecker checker;
  for (int k = 0; k < 3; ++k) checker.begin(checks.make(""));
  ASSERT_TRUE(eventually([&] { return checks.begun == 2; }));
  checker.discard();
  checks.may_end = true;
  ASSERT_TRUE(eventually([&] { return checks.running == 0; }));
  EXPECT_FALSE(checker.take());
  EXPECT_EQ(checks.begun, 2);
}

TEST(PathChecker, ItsEndStopsAllChecks) {
  Checks checks;
  {
    PathChecker checker;
    checker.begin(checks.make(""));
    checker.begin(checks.make(""));
    ASSERT_TRUE(eventually([&] { return checks.begun == 2; }));
  }
  EXPECT_EQ(checks.stopped, 2);
  EXPECT_EQ(checks.running, 0);
}

using Bytes = std::vector<std::uint8_t>;

// A goal of so many points in the frame "wall", as roscpp writes it.
Bytes goalBytes(std::size_t points) {
  FollowTipPathActionGoal goal;
  goal.goal_id.id = "this one";
  goal.goal.path.header.frame_id = "wall";
  goal.goal.path.joint_names = {"tip"};
  goal.goal.path.points.resize(points);
  for (std::size_t k = 0; k < points; ++k) {
    auto& point = goal.goal.path.points[k];
    point.transforms.resize(1);
    point.transforms[0].translation.x = 0.1;
    point.time_from_start = ros::Duration(0.01 * static_cast<double>(k));
  }
  goal.goal.path_tolerance = 0.004;
  Bytes out(ros::serialization::serializationLength(goal));
  ros::serialization::OStream stream(out.data(), static_cast<std::uint32_t>(out.size()));
  ros::serialization::serialize(stream, goal);
  return out;
}

// As the subscription of the action server reads it.
UnreadActionGoal received(Bytes bytes) {
  UnreadActionGoal out;
  ros::serialization::IStream stream(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  ros::serialization::deserialize(stream, out);
  EXPECT_EQ(stream.getLength(), 0U);
  return out;
}

// Where a path has the number of its points, after two headers, the goal's id and one joint name.
std::size_t placeOfCount(const Bytes& bytes) {
  const std::string name = "tip";
  return static_cast<std::size_t>(
      std::search(bytes.begin(), bytes.end(), name.begin(), name.end()) - bytes.begin() + 3);
}

const PathCheck kAnyPath = [](const control::TipPath&, double, const std::atomic<bool>&) {
  return std::string();
};

TEST(UnreadGoal, HoldsTheBytesOfItsGoal) {
  const UnreadActionGoal goal = received(goalBytes(3));
  EXPECT_EQ(goal.goal_id.id, "this one");
  EXPECT_EQ(goal.goal.path_header.frame_id, "wall");
  EXPECT_EQ(goal.goal.points, 3U);
  ASSERT_TRUE(goal.goal.bytes);
  EXPECT_EQ(goal.goal.bytes->size(), goal.goal.size);
  EXPECT_FALSE(refusalOf(goal.goal, 0.5));
  double tolerance = 0.0;
  const lie::SE3 X_BF{Eigen::Matrix3d::Identity(), {0, 0, 1}};
  const DecidedGoal decided = decide(
      goal.goal, X_BF,
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
                goal.goal, {}, [](auto&&...) { return "too fast"; }, false)),
            "too fast");
}

// What the thread of the turns does is the same for any number of points: no point is looked at.
TEST(UnreadGoal, IsReceivedWithoutALookAtItsPoints) {
  Bytes bytes = goalBytes(2);
  std::fill(bytes.begin() + static_cast<std::ptrdiff_t>(placeOfCount(bytes)) + 4, bytes.end(),
            0xff);
  const UnreadActionGoal goal = received(bytes);
  EXPECT_EQ(goal.goal.points, 2U);
  EXPECT_FALSE(refusalOf(goal.goal, 0.5));
  // Only its check finds that the arrays of its first point are longer than the goal.
  EXPECT_NE(messageOf(decide(goal.goal, {}, kAnyPath, false)), "");
}

TEST(UnreadGoal, OfTooManyPointsIsRefusedForTheirNumberAndNotKept) {
  for (const std::uint32_t claim : {100'000U, 100'001U, 1'000'000U, 0xffffffffU}) {
    Bytes bytes = goalBytes(2);
    std::memcpy(bytes.data() + placeOfCount(bytes), &claim, sizeof claim);
    const UnreadActionGoal goal = received(bytes);
    EXPECT_EQ(goal.goal.points, claim);
    EXPECT_EQ(goal.goal.bytes != nullptr, claim <= control::kMostWayPoints);
    const auto refusal = refusalOf(goal.goal, 0.5);
    ASSERT_EQ(refusal.has_value(), claim > control::kMostWayPoints);
    if (!refusal) continue;
    EXPECT_EQ(refusal->code, Result::INVALID_GOAL);
    EXPECT_EQ(refusal->message, "the path has " + std::to_string(claim) +
                                    " points; expected at most 100000: send it in parts");
  }
}

TEST(UnreadGoal, OfTooManyBytesIsRefusedForThemAndNotKept) {
  const Bytes small = goalBytes(2);
  const std::size_t ids = small.size() - received(small).goal.size;
  for (const std::size_t size : {std::size_t{kMostGoalBytes}, kMostGoalBytes + std::size_t{1}}) {
    Bytes bytes = small;
    bytes.resize(ids + size);
    const UnreadActionGoal goal = received(bytes);
    EXPECT_EQ(goal.goal.size, size);
    EXPECT_EQ(goal.goal.bytes != nullptr, size <= kMostGoalBytes);
    const auto refusal = refusalOf(goal.goal, 0.5);
    ASSERT_EQ(refusal.has_value(), size > kMostGoalBytes);
    if (!refusal) continue;
    EXPECT_EQ(refusal->message.find("the goal has 20000001 bytes; expected at most 20000000: "), 0U)
        << refusal->message;
  }
}

// The largest goal that follows the rules fits.
static_assert(control::kMostWayPoints * (3 * 4 + 56 + 48 + 48 + 8) + 1000 <= kMostGoalBytes);

}  // namespace
}  // namespace helix_arm::ros_bridge
