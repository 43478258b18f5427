#include <fstream>
#include <functional>

#include <gtest/gtest.h>

#include "helix_arm/regulator/guard_process.hpp"
#include "support/allocation_counter.hpp"
#include "support/eventually.hpp"
#include "support/scripted_driver.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::regulator {
namespace {

using control::SafetyCause;
using control::SafetyCore;
using control::SafetyState;
using control::Valve;
using test::eventually;
using test::ScriptedDevice;
using test::ScriptedDriver;

constexpr int kChannels = 2;

SafetyCore coreOfTwo() {
  control::SafetyRules rules;
  rules.target_timeout = 60;
  rules.follow_time = 60;  // the scripted device does not follow
  return {{{"left", {0, 3e5}}, {"right", {0, 3e5}}}, rules};
}

class Path : public ::testing::Test {
 protected:
  Path() {
    IoRules rules;
    rules.period = 0.001;
    rules.first_back_off = rules.longest_back_off = 0.001;
    path_.emplace(coreOfTwo(), std::make_unique<RegulatorIo>(
                                   std::make_unique<ScriptedDriver>(device_), kChannels, rules));
  }

  bool turnUntil(const std::function<bool()>& condition) {
    return eventually([&] {
      path_->turn(steadyNow());
      return condition();
    });
  }
  void enable() {
    ASSERT_TRUE(turnUntil([&] { return path_->core().enable(steadyNow()).empty(); }))
        << path_->core().refusal(steadyNow());
  }

  ScriptedDevice device_{kChannels};
  std::optional<PressurePath> path_;
};

TEST_F(Path, ATargetReachesTheDeviceOnceEnabled) {
  const Eigen::Vector2d wanted(1e5, 2e5);
  EXPECT_FALSE(path_->target(steadyNow(), wanted));
  enable();
  ASSERT_TRUE(path_->target(steadyNow(), wanted));
  ASSERT_TRUE(turnUntil([&] { return device_.taken().set_point == wanted; }));
  EXPECT_EQ(device_.taken().valve, std::vector<Valve>(kChannels, Valve::kRegulate));
}

TEST_F(Path, ReadingsComeToTheCore) {
  device_.read(Eigen::Vector2d(2e3, 3e3));
  ASSERT_TRUE(turnUntil([&] {
    return path_->news() != nullptr && path_->core().reading() == Eigen::Vector2d(2e3, 3e3);
  }));
}

TEST_F(Path, ALinkThatDropsAndComesBackBetweenTwoTurnsHasDropped) {
  enable();
  const std::uint64_t breaks = path_->io()->breaks();
  device_.mute = true;
  ASSERT_TRUE(eventually([&] { return path_->io()->breaks() > breaks; }));
  device_.mute = false;
  ASSERT_TRUE(eventually([&] { return path_->io()->up(); }));
  path_->turn(steadyNow());
  EXPECT_EQ(path_->core().report().cause, SafetyCause::kRegulatorLost);
  ASSERT_TRUE(turnUntil([&] { return path_->core().state() == SafetyState::kVented; }));
}

TEST_F(Path, ADeviceThatHangsIsAFault) {
  enable();
  device_.hangs = true;
  EXPECT_TRUE(turnUntil([&] { return path_->core().state() == SafetyState::kFault; }));
  EXPECT_EQ(path_->core().report().cause, SafetyCause::kStaleReading);
  device_.hangs = false;
  ASSERT_TRUE(turnUntil([&] { return path_->core().state() == SafetyState::kVented; }));
  EXPECT_TRUE(eventually([&] { return device_.taken().valve[0] == Valve::kVent; }));
}

// The guard answers once a file is there, and ends once another one is.
TEST_F(Path, IsEnabledOnlyWhileItsGuardIsReady) {
  const test::TemporaryFolder folder;
  const std::string answers = folder / "answers";
  const auto refusal = [&] { return path_->enable(steadyNow()); };
  const auto guard = std::make_shared<GuardProcess>(std::vector<std::string>{
      "/bin/sh", "-c", "until [ -e \"$0\" ]; do sleep 0.05; done; exec tee /dev/null >&0",
      answers});
  path_->guardedBy(guard);
  ASSERT_TRUE(turnUntil([&] { return path_->io()->status().reads > 0; }));
  const std::string early = refusal();
  EXPECT_NE(early.find("the guard"), std::string::npos) << early;
  EXPECT_NE(early.find("has not answered yet"), std::string::npos) << early;
  EXPECT_EQ(path_->core().state(), SafetyState::kDisabled);
  std::ofstream(answers).put('\n');
  ASSERT_TRUE(turnUntil([&] { return refusal().empty(); })) << refusal();
  EXPECT_EQ(path_->core().state(), SafetyState::kEnabled);

  // It goes: known with the next turn, before it could have missed a beat.
  guard->dismiss();
  path_->turn(steadyNow());
  EXPECT_EQ(path_->core().report().cause, SafetyCause::kGuardLost);
  EXPECT_EQ(path_->core().orders().valve[0], Valve::kVent);
  ASSERT_TRUE(turnUntil([&] { return path_->core().state() == SafetyState::kVented; }));
  const std::string late = refusal();
  EXPECT_NE(late.find("the guard"), std::string::npos) << late;
  EXPECT_NE(late.find("has ended"), std::string::npos) << late;

  const auto next = std::make_shared<GuardProcess>(
      std::vector<std::string>{"/bin/sh", "-c", "exec tee /dev/null >&0"});
  path_->guardedBy(next);
  EXPECT_TRUE(turnUntil([&] { return refusal().empty(); })) << refusal();
  next->dismiss();
}

TEST(PressurePath, TurnsThatAreTooFarApartAreALostLink) {
  for (const double gap : {0.39, 0.41}) {
    PressurePath path(coreOfTwo(), nullptr, 0.4);
    path.core().measured(0, Eigen::Vector2d::Zero());
    ASSERT_EQ(path.core().enable(0), "");
    path.turn(0.001);
    path.turn(0.001 + gap);
    EXPECT_EQ(path.core().report().cause,
              gap > 0.4 ? SafetyCause::kRegulatorLost : SafetyCause::kNone);
  }
  EXPECT_THROW(PressurePath(coreOfTwo(), nullptr, 0), std::invalid_argument);
}

TEST(PressurePath, WithoutIoTheOrdersAreForSomebodyElse) {
  PressurePath path(coreOfTwo(), nullptr);
  path.core().measured(0, Eigen::Vector2d::Zero());
  ASSERT_EQ(path.core().enable(0), "");
  ASSERT_TRUE(path.target(0.001, Eigen::Vector2d(1e5, 2e5)));
  EXPECT_EQ(path.turn(0.002).set_point, Eigen::Vector2d(1e5, 2e5));
  EXPECT_EQ(path.news(), nullptr);
}

TEST(PressurePath, ATurnDoesNotAllocate) {
  ScriptedDevice device(kChannels);
  PressurePath path(coreOfTwo(),
                    std::make_unique<RegulatorIo>(std::make_unique<ScriptedDriver>(device),
                                                  kChannels, IoRules()));
  ASSERT_TRUE(eventually([&] {
    path.turn(steadyNow());
    return path.core().enable(steadyNow()).empty();
  }));
  const Eigen::Vector2d wanted(1e5, 2e5);
  int taken = 0;
  const test::AllocationCounter counter;
  for (int i = 0; i < 1000; ++i) taken += path.target(steadyNow(), wanted);
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_EQ(taken, 1000);
}

}  // namespace
}  // namespace helix_arm::regulator
