// Calls that hang hold up neither their caller nor other calls.
#include "helix_arm/ros_bridge/cockpit/call_desk.hpp"

#include <chrono>
#include <condition_variable>
#include <future>
#include <mutex>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>

namespace helix_arm::ros_bridge {
namespace {

constexpr double kLong = 60;    // no call of these tests lasts so long [s]
constexpr double kShort = 0.1;  // [s]

class CallDeskTest : public ::testing::Test {
 protected:
  ~CallDeskTest() override { open_.set_value(); }

  CallDesk::Done note() {
    return [this](const CallAnswer& answer) {
      const std::lock_guard<std::mutex> lock(mutex_);
      answers_.push_back(answer);
      came_.notify_all();
    };
  }
  // The answers once there are this many.
  std::vector<CallAnswer> answers(std::size_t count) {
    std::unique_lock<std::mutex> lock(mutex_);
    came_.wait_for(lock, std::chrono::seconds(30), [&] { return answers_.size() >= count; });
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
  std::mutex mutex_;
  std::condition_variable came_;
  std::vector<CallAnswer> answers_;
};

TEST_F(CallDeskTest, TellsTheAnswer) {
  CallDesk desk(note());
  desk.ask("Enable", kLong, [] { return CallAnswer{"", true, "enabled: follows targets"}; });
  const auto answers = this->answers(1);
  ASSERT_EQ(answers.size(), 1U);
  EXPECT_EQ(answers[0].what, "Enable");
  EXPECT_TRUE(answers[0].success);
  EXPECT_EQ(answers[0].message, "enabled: follows targets");
}

TEST_F(CallDeskTest, WhatACallThrowsIsItsAnswer) {
  CallDesk desk(note());
  desk.ask("Vent", kLong, []() -> CallAnswer { throw std::runtime_error("no such service"); });
  const auto answers = this->answers(1);
  ASSERT_EQ(answers.size(), 1U);
  EXPECT_FALSE(answers[0].success);
  EXPECT_EQ(answers[0].message, "no such service");
}

TEST_F(CallDeskTest, ACallThatHangsIsGivenUpOnAndHoldsUpNoStop) {
  CallDesk desk(note());
  desk.ask("Enable", kShort, hanging());
  desk.ask("Emergency stop", kLong, [] { return CallAnswer{"", true, "fault"}; });
  const auto answers = this->answers(2);
  ASSERT_EQ(answers.size(), 2U);
  EXPECT_EQ(answers[0].what + answers[1].what == "EnableEmergency stop" ||
                answers[0].what + answers[1].what == "Emergency stopEnable",
            true);
  for (const CallAnswer& answer : answers) EXPECT_EQ(answer.success, answer.what != "Enable");
}

TEST_F(CallDeskTest, CallsThatHangAreLimitedByName) {
  CallDesk desk(note());
  for (int k = 0; k < CallDesk::kMostWaiting + 3; ++k) desk.ask("Enable", kLong, hanging());
  const auto answers = this->answers(3);
  ASSERT_EQ(answers.size(), 3U);
  EXPECT_NE(answers[2].message.find("earlier calls"), std::string::npos);
  desk.ask("Vent", kLong, [] { return CallAnswer{"", true, ""}; });
  EXPECT_TRUE(this->answers(4).back().success);
}

TEST_F(CallDeskTest, ItsEndNeitherWaitsForACallNorIsToldOfOne) {
  const auto before = std::chrono::steady_clock::now();
  std::promise<void> ended;
  {
    CallDesk desk(note());
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
  EXPECT_TRUE(answers_.empty());
}

}  // namespace
}  // namespace helix_arm::ros_bridge
