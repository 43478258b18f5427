#include "regulator/regulator_io.hpp"

#include <atomic>
#include <fstream>
#include <functional>
#include <mutex>
#include <thread>

#include <gtest/gtest.h>

#include "regulator/guard_process.hpp"
#include "support/allocation_counter.hpp"
#include "support/eventually.hpp"
#include "support/refusal.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::regulator {
namespace {

using control::Valve;
using control::ValveOrders;
using test::eventually;

constexpr int kChannels = 2;
constexpr double kOrderTimeout = 0.2;  // [s]

// What a regulator does, in the hands of a test; shared with the driver that speaks to it.
class ScriptedDevice {
 public:
  explicit ScriptedDevice(int channels)
      : taken_(channels), reading_(Eigen::VectorXd::Zero(channels)) {}

  std::atomic<bool> refuses{false};    // to be connected to
  std::atomic<bool> mute{false};       // the link is down
  std::atomic<int> bad_replies{0};     // so many answers are garbage
  std::atomic<bool> keeps_air{false};  // once its link is closed
  std::atomic<bool> hangs{false};      // an exchange does not come back until it is false
  std::atomic<double> watchdog{std::numeric_limits<double>::infinity()};  // of its line [s]
  std::atomic<int> attempts{0}, connections{0}, vents{0}, closings{0}, writes{0};

  ValveOrders taken() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return taken_;
  }
  void set(const ValveOrders& orders) {
    const std::lock_guard<std::mutex> lock(mutex_);
    taken_ = orders;
  }
  Eigen::VectorXd reading() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return reading_;
  }
  void read(const Eigen::VectorXd& reading) {
    const std::lock_guard<std::mutex> lock(mutex_);
    reading_ = reading;
  }

 private:
  mutable std::mutex mutex_;
  ValveOrders taken_;
  Eigen::VectorXd reading_;
};

class ScriptedDriver : public Driver {
 public:
  explicit ScriptedDriver(ScriptedDevice& device) : device_(device) {}

  void connect() override {
    ++device_.attempts;
    if (device_.refuses || device_.mute) throw LinkError("refused");
    device_.set(ValveOrders(static_cast<int>(device_.reading().size())));
    ++device_.connections;
  }
  void write(const ValveOrders& orders) override {
    exchange();
    device_.set(orders);
    ++device_.writes;
  }
  void read(Pressures& pressures) override {
    exchange();
    pressures.pressure = device_.reading();
  }
  void vent() override {
    exchange();
    device_.set(ValveOrders(static_cast<int>(device_.reading().size())));
    ++device_.vents;
  }
  bool keepsAirOnClose() const noexcept override { return device_.keeps_air; }
  double watchdog() const noexcept override { return device_.watchdog; }
  void close() noexcept override { ++device_.closings; }

 private:
  void exchange() {
    while (device_.hangs) std::this_thread::yield();
    if (device_.mute) throw LinkError("no answer");
    if (device_.bad_replies > 0) {
      --device_.bad_replies;
      throw BadReply("garbage");
    }
  }

  ScriptedDevice& device_;
};

IoRules briskRules() {
  IoRules rules;
  rules.period = 0.002;
  rules.order_timeout = kOrderTimeout;
  rules.first_back_off = 0.01;
  rules.longest_back_off = 0.04;
  rules.most_bad_replies = 3;
  return rules;
}

ValveOrders ordersOf(double first, double second) {
  ValveOrders orders(kChannels);
  orders.valve.assign(kChannels, Valve::kRegulate);
  orders.set_point << first, second;
  return orders;
}

class Io : public ::testing::Test {
 protected:
  Io() : io_(std::make_unique<ScriptedDriver>(device_), kChannels, briskRules()) {}

  bool regulates(double first) const {
    const ValveOrders taken = device_.taken();
    return taken.valve[0] == Valve::kRegulate && taken.set_point[0] == first;
  }
  bool vents() const {
    const ValveOrders taken = device_.taken();
    return taken.valve == std::vector<Valve>(kChannels, Valve::kVent);
  }
  // Gives the orders until the condition holds.
  bool keepOrdering(const ValveOrders& orders, const std::function<bool()>& condition) {
    return eventually([&] {
      io_.order(orders, io_.breaks());
      return condition();
    });
  }

  ScriptedDevice device_{kChannels};
  RegulatorIo io_;
};

TEST_F(Io, WritesTheNewestOrdersAndReads) {
  device_.read(Eigen::Vector2d(1e5, 2e5));
  ASSERT_TRUE(keepOrdering(ordersOf(3e4, 4e4), [&] { return regulates(3e4); }));
  ASSERT_TRUE(keepOrdering(ordersOf(5e4, 4e4), [&] { return regulates(5e4); }));
  Reading reading(kChannels);
  const double asked = steadyNow();
  ASSERT_TRUE(eventually([&] { return io_.take(reading) && reading.time >= asked; }));
  EXPECT_EQ(reading.pressures.pressure, Eigen::Vector2d(1e5, 2e5));
  EXPECT_LE(reading.time, steadyNow());
  const IoStatus status = io_.status();
  EXPECT_TRUE(status.up);
  EXPECT_EQ(status.connections, 1u);
  EXPECT_GT(status.writes, 1u);
  EXPECT_GT(status.reads, 0u);
  EXPECT_EQ(status.breaks, 0u);
}

TEST_F(Io, WithoutOrdersItVentsByItself) {
  double last_order = 0;
  ASSERT_TRUE(eventually([&] {
    last_order = steadyNow();
    io_.order(ordersOf(3e4, 4e4), io_.breaks());
    return regulates(3e4);
  }));
  const IoStatus before = io_.status();
  ASSERT_TRUE(eventually([&] { return vents(); }));
  EXPECT_GE(steadyNow() - last_order, kOrderTimeout);
  EXPECT_EQ(io_.status().own_vents, before.own_vents + 1);
  EXPECT_EQ(io_.breaks(), before.breaks + 1);
  EXPECT_TRUE(io_.up());
  ASSERT_TRUE(keepOrdering(ordersOf(3e4, 4e4), [&] { return regulates(3e4); }));
}

TEST_F(Io, AHangingDeviceDelaysNoCaller) {
  ASSERT_TRUE(eventually([&] { return io_.up(); }));
  device_.hangs = true;
  for (int i = 0; i < 1000; ++i) io_.order(ordersOf(i, i), io_.breaks());
  Reading reading(kChannels);
  io_.take(reading);
  io_.status();
  device_.hangs = false;
  ASSERT_TRUE(keepOrdering(ordersOf(7e4, 0), [&] { return regulates(7e4); }));
}

TEST_F(Io, ALostLinkIsTriedAgainWithGrowingPauses) {
  ASSERT_TRUE(eventually([&] { return io_.up(); }));
  device_.mute = true;
  ASSERT_TRUE(eventually([&] { return !io_.up(); }));
  EXPECT_EQ(io_.breaks(), 1u);
  const double begin = steadyNow();
  const int attempts = device_.attempts;
  ASSERT_TRUE(eventually([&] { return device_.attempts >= attempts + 6; }));
  // 10, 20, 40, 40, 40 ms between six attempts.
  EXPECT_GE(steadyNow() - begin, 0.14);
  EXPECT_EQ(io_.status().last_error, "refused");
  device_.mute = false;
  ASSERT_TRUE(eventually([&] { return io_.up(); }));
  EXPECT_EQ(io_.status().connections, 2u);
}

TEST_F(Io, OrdersFromBeforeALossAreNotWritten) {
  ASSERT_TRUE(keepOrdering(ordersOf(3e4, 4e4), [&] { return regulates(3e4); }));
  device_.mute = true;
  ASSERT_TRUE(eventually([&] { return io_.breaks() == 1; }));
  device_.mute = false;
  ASSERT_TRUE(eventually([&] { return io_.up(); }));
  const int writes = device_.writes;
  Reading reading(kChannels);
  for (int i = 0; i < 20; ++i) {  // whoever gives them has not heard of the loss yet
    io_.order(ordersOf(3e4, 4e4), 0);
    ASSERT_TRUE(eventually([&] { return io_.take(reading); }));
  }
  EXPECT_EQ(device_.writes, writes);
  EXPECT_TRUE(vents());
  ASSERT_TRUE(keepOrdering(ordersOf(3e4, 4e4), [&] { return regulates(3e4); }));
}

TEST_F(Io, FewBadRepliesAreCountedAndManyEndTheLink) {
  ASSERT_TRUE(eventually([&] { return io_.up(); }));
  device_.bad_replies = 2;
  ASSERT_TRUE(eventually([&] { return io_.status().bad_replies == 2; }));
  const std::uint64_t reads = io_.status().reads;
  ASSERT_TRUE(eventually([&] { return io_.status().reads > reads; }));
  EXPECT_EQ(io_.breaks(), 0u);
  EXPECT_EQ(io_.status().last_error, "garbage");
  device_.bad_replies = 3;
  ASSERT_TRUE(eventually([&] { return io_.breaks() == 1; }));
  ASSERT_TRUE(eventually([&] { return io_.up(); }));
}

TEST(RegulatorIo, OrderingAndTakingDoNotAllocate) {
  ScriptedDevice device(kChannels);
  device.refuses = true;  // the thread of the line is asleep, or nearly
  IoRules rules = briskRules();
  rules.first_back_off = rules.longest_back_off = 60;
  RegulatorIo io(std::make_unique<ScriptedDriver>(device), kChannels, rules);
  ASSERT_TRUE(eventually([&] { return !io.status().last_error.empty(); }));
  const ValveOrders orders = ordersOf(1e5, 2e5);
  Reading reading(kChannels);
  const test::AllocationCounter counter;
  for (int i = 0; i < 1000; ++i) {
    io.order(orders, 0);
    io.take(reading);
  }
  EXPECT_EQ(counter.count(), 0u);
}

TEST(RegulatorIo, RefusesADeviceThatWouldVentBetweenTwoLines) {
  ScriptedDevice device(kChannels);
  IoRules rules = briskRules();
  rules.period = 0.125;
  const auto refusalOf = [&](double watchdog) {
    device.watchdog = watchdog;
    return test::refusal(
        [&] { RegulatorIo(std::make_unique<ScriptedDriver>(device), kChannels, rules); });
  };
  EXPECT_EQ(refusalOf(0.5), "accepted");
  const std::string refused = refusalOf(0.49);
  EXPECT_NE(refused.find("no line comes for 0.49 s"), std::string::npos) << refused;
  EXPECT_NE(refused.find("expected at most 0.1225 s"), std::string::npos) << refused;
}

TEST(Mailbox, FetchedValuesAreCompleteAndNeverOlder) {
  struct Pair {
    std::uint64_t first = 0, second = 0;
  };
  constexpr std::uint64_t kPosts = 1000000;
  Mailbox<Pair> box({});
  std::thread sender([&] {
    for (std::uint64_t i = 1; i <= kPosts; ++i) {
      box.draft() = {i, ~i};
      box.post();
    }
  });
  std::uint64_t last = 0, torn = 0, older = 0;
  while (last < kPosts) {
    if (!box.fetch()) continue;
    torn += box.held().second != ~box.held().first;
    older += box.held().first <= last;
    last = box.held().first;
  }
  sender.join();
  EXPECT_EQ(torn, 0u);
  EXPECT_EQ(older, 0u);
}

// Some devices keep their air once the link is gone.
TEST(RegulatorIo, HoldsALinkThatTheVentNeeds) {
  for (const bool keeps_air : {false, true}) {
    ScriptedDevice device(kChannels);
    device.keeps_air = keeps_air;
    IoRules rules = briskRules();
    rules.vent_time = 0.3;
    RegulatorIo io(std::make_unique<ScriptedDriver>(device), kChannels, rules);
    ASSERT_TRUE(eventually([&] { return io.up(); }));
    const int closings = device.closings;
    const double broken = steadyNow();
    device.mute = true;
    ASSERT_TRUE(eventually([&] { return device.closings > closings; }));
    const double held = steadyNow() - broken;
    EXPECT_TRUE(!keeps_air || held > 0.9 * rules.vent_time) << held;
  }
}

TEST(RegulatorIo, KeepsItsLinkUntilNoPressureRemains) {
  for (const bool empties : {false, true}) {
    ScriptedDevice device(kChannels);
    device.read(Eigen::Vector2d(1e5, 0));
    IoRules rules = briskRules();
    rules.vent_time = empties ? 20 : 0.1;
    RegulatorIo io(std::make_unique<ScriptedDriver>(device), kChannels, rules);
    ASSERT_TRUE(eventually([&] { return io.up(); }));
    const int vents = device.vents, closings = device.closings;
    std::thread emptying([&] {
      if (!eventually([&] { return device.vents > vents; }) || !empties) return;
      EXPECT_EQ(device.closings, closings);
      device.read(Eigen::Vector2d::Zero());
    });
    EXPECT_EQ(io.end(), empties);
    emptying.join();
    EXPECT_EQ(device.closings, closings + 1);
  }
}

// ---- The safety core in front of it -------------------------------------------------------------

using control::SafetyCause;
using control::SafetyCore;
using control::SafetyState;

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
