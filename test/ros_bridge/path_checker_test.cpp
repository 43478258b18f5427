#include "helix_arm/ros_bridge/follow/path_checker.hpp"

#include <stdexcept>
#include <thread>

#include <gtest/gtest.h>

#include "support/eventually.hpp"

namespace helix_arm::ros_bridge {
namespace {

using test::eventually;

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
      return result;
    };
  }
};

// Its result, once it has come.
std::optional<std::string> resultOf(PathChecker& checker) {
  std::optional<std::string> out;
  eventually([&] { return (out = checker.take()).has_value(); });
  return out;
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
  checker.begin([](const std::atomic<bool>&) -> std::string {
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

}  // namespace
}  // namespace helix_arm::ros_bridge
