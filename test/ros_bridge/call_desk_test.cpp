// Calls that hang hold up neither their caller nor other calls.
#include <chrono>
#include <future>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>

#include "ros_bridge/cockpit/cockpit_link.hpp"
#include "support/eventually.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr double kLong = 60;    // no call of these tests lasts so long [s]
constexpr double kShort = 0.1;  // [s]

class CallDeskTest : public ::testing::Test {
 protected:
  ~CallDeskTest() override { open_.set_value(); }

  // The answers once there are this many.
  std::vector<CallAnswer> answers(std::size_t count) {
    test::eventually(
        [&] {
          for (CallAnswer& answer : desk_.take()) answers_.push_back(std::move(answer));
          return answers_.size() >= count;
        },
        30);
    return answers_;
  }
  // A call that ends with the test.
  CallDesk::Call hanging() {
    return [gate = gate_] {
      gate.wait();
      return CallAnswer{"", true, "late"};
    };
  }

  std::promise<void> open_;
  const std::shared_future<void> gate_ = open_.get_future().share();
  CallDesk desk_;
  std::vector<CallAnswer> answers_;
};

TEST_F(CallDeskTest, TellsTheAnswer) {
  desk_.ask("Enable", kLong, [] { return CallAnswer{"", true, "enabled: follows targets"}; });
  const auto answers = this->answers(1);
  ASSERT_EQ(answers.size(), 1U);
  EXPECT_EQ(answers[0].what, "Enable");
  EXPECT_TRUE(answers[0].success);
  EXPECT_EQ(answers[0].message, "enabled: follows targets");
}

TEST_F(CallDeskTest, WhatACallThrowsIsItsAnswer) {
  desk_.ask("Vent", kLong, []() -> CallAnswer { throw std::runtime_error("no such service"); });
  const auto answers = this->answers(1);
  ASSERT_EQ(answers.size(), 1U);
  EXPECT_FALSE(answers[0].success);
  EXPECT_EQ(answers[0].message, "no such service");
}

TEST_F(CallDeskTest, ACallThatHangsIsGivenUpOnAndHoldsUpNoStop) {
  desk_.ask("Enable", kShort, hanging());
  desk_.ask("Emergency stop", kLong, [] { return CallAnswer{"", true, "fault"}; });
  const auto answers = this->answers(2);
  ASSERT_EQ(answers.size(), 2U);
  EXPECT_EQ(answers[0].what + answers[1].what == "EnableEmergency stop" ||
                answers[0].what + answers[1].what == "Emergency stopEnable",
            true);
  for (const CallAnswer& answer : answers) EXPECT_EQ(answer.success, answer.what != "Enable");
}

TEST_F(CallDeskTest, CallsThatHangAreLimitedByName) {
  for (int k = 0; k < CallDesk::kMostWaiting + 3; ++k) desk_.ask("Enable", kLong, hanging());
  const auto answers = this->answers(3);
  ASSERT_EQ(answers.size(), 3U);
  EXPECT_NE(answers[2].message.find("earlier calls"), std::string::npos);
  desk_.ask("Vent", kLong, [] { return CallAnswer{"", true, ""}; });
  EXPECT_TRUE(this->answers(4).back().success);
}

TEST_F(CallDeskTest, KnowsWhichCallsWait) {
  EXPECT_FALSE(desk_.waits("Enable"));
  desk_.ask("Enable", kLong, hanging());
  desk_.ask("Vent", kShort, hanging());
  EXPECT_TRUE(desk_.waits("Enable"));
  EXPECT_FALSE(desk_.waits("Release"));
  ASSERT_EQ(this->answers(1).size(), 1U);
  EXPECT_FALSE(desk_.waits("Vent")) << "given up on";
}

// A node that hung and was started again must still hear a stop.
TEST_F(CallDeskTest, CallsGivenUpOnLeaveRoomForAnother) {
  for (int k = 0; k < CallDesk::kMostWaiting; ++k) desk_.ask("Emergency stop", kShort, hanging());
  ASSERT_EQ(this->answers(CallDesk::kMostWaiting).size(), std::size_t{CallDesk::kMostWaiting});
  desk_.ask("Emergency stop", kLong, [] { return CallAnswer{"", true, "engaged"}; });
  const auto answers = this->answers(CallDesk::kMostWaiting + 1);
  ASSERT_EQ(answers.size(), std::size_t{CallDesk::kMostWaiting + 1});
  EXPECT_TRUE(answers.back().success) << answers.back().message;
}

TEST_F(CallDeskTest, ThreadsOfCallsThatHangAreBounded) {
  std::size_t asked = 0;
  const auto few = [&] {
    for (int k = 0; k < CallDesk::kMostWaiting; ++k, ++asked) desk_.ask("Vent", kShort, hanging());
    return this->answers(asked);
  };
  for (int k = 0; k < CallDesk::kMostRunning / CallDesk::kMostWaiting; ++k) {
    const auto answers = few();
    ASSERT_EQ(answers.size(), asked);
    EXPECT_NE(answers.back().message.find("no answer within"), std::string::npos);
  }
  EXPECT_NE(few().back().message.find("too many calls hang"), std::string::npos);
}

TEST_F(CallDeskTest, EveryFailureHasTheRemedyAndSuccessHasNone) {
  desk_.ask("Stop", kShort, hanging(), "by hand");
  auto late = answers(1);
  EXPECT_FALSE(late.back().answered);
  EXPECT_EQ(late.back().remedy, "by hand");
  desk_.ask(
      "Stop", kLong,
      [] {
        return CallAnswer{"", false, "no"};
      },
      "by hand");
  EXPECT_TRUE(answers(2).back().answered);
  EXPECT_EQ(answers(2).back().remedy, "by hand");
  desk_.ask(
      "Stop", kLong, []() -> CallAnswer { throw std::runtime_error("cut off"); }, "by hand");
  EXPECT_EQ(answers(3).back().remedy, "by hand");
  desk_.ask(
      "Stop", kLong,
      [] {
        return CallAnswer{"", true, "yes"};
      },
      "by hand");
  EXPECT_EQ(answers(4).back().remedy, "");
  for (int k = 0; k <= CallDesk::kMostWaiting; ++k) desk_.ask("Many", kLong, hanging(), "by hand");
  EXPECT_EQ(answers(5).back().remedy, "by hand") << "refused, since too many wait";
}

TEST_F(CallDeskTest, ItsEndDoesNotWaitForACall) {
  const auto before = std::chrono::steady_clock::now();
  std::promise<void> ended;
  {
    CallDesk desk;
    desk.ask("Enable", kLong, [gate = gate_, &ended] {
      gate.wait();
      ended.set_value();
      return CallAnswer{"", true, "late"};
    });
  }
  EXPECT_LT(std::chrono::steady_clock::now() - before, std::chrono::seconds(20));
  open_.set_value();
  open_ = {};  // for the destructor
  ended.get_future().wait();
}

}  // namespace
}  // namespace helix_arm::ros_bridge
