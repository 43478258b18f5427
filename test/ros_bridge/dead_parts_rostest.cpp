// The fault matrix of what is around the regulator: commander, node, rig and eyes die, and the arm
// comes to the state that is said of it within the time that is said of it.
#include <cmath>
#include <csignal>

#include "regulator/guard_process.hpp"
#include "support/hardware_rig.hpp"

namespace helix_arm::test {
namespace {

const Eigen::Vector3d kPressures(1.5e5, 1e5, 5e4);  // [Pa]
constexpr double kAtOnce = 0;
// Time until a stopped process is detected [s].
constexpr double kStandstill =
    regulator::GuardProcess::kMissedBeats * regulator::GuardProcess::kBeatPeriod;
constexpr double kGuardLooks = 1;       // the node looks after its guard so often [s]
constexpr double kBoardWatchdog = 0.5;  // of config/regulators/generic.yaml [s]

// Rules of the scene `demo` [s].
constexpr double kDemoReadingTimeout = 0.5;
constexpr double kDemoVentTime = 3;
constexpr double kCommandTimeout = 0.5;  // of simulated_rig

void tellFigure(const char* what, double since) {
  const double after = regulator::steadyNow() - since;
  std::printf("[  FIGURE  ] %s: the regulator vents after %.0f ms\n", what, 1e3 * after);
}

class DeadParts : public ::testing::TestWithParam<Line> {
 protected:
  void SetUp() override { ASSERT_TRUE(rig_.bringTo(kPressures)) << rig_.node.output(); }

  bool deviceVents(double rule) { return rig_.ventsBy(regulator::steadyNow(), rule + kSlack); }

  // By what they say of a scene that is not there.
  int guardsStarted() {
    int count = 0;
    const std::string& output = rig_.node.outputNow();
    const std::string words = regulator_.scene() + " cannot be read";
    for (std::size_t at = output.find(words); at != std::string::npos;
         at = output.find(words, at + 1)) {
      ++count;
    }
    return count;
  }

  void expectEmpties() {
    EXPECT_TRUE(eventually([this] { return regulator_.pressure().maxCoeff() < kEmpty; },
                           kVentTime + kSlack));
  }

  // A guard is gone, or as good as that: the arm does not stay inflated without one.
  void expectAnotherGuardAfter(int signal, double rule) {
    const std::vector<pid_t> first = guardsOf(regulator_.scene());
    ASSERT_EQ(first.size(), 1u);
    const double begin = regulator::steadyNow();
    ASSERT_EQ(kill(first[0], signal), 0);
    EXPECT_TRUE(deviceVents(rule));
    tellFigure(signal == SIGSTOP ? "guard stopped" : "guard killed", begin);
    EXPECT_TRUE(rig_.comesTo("vented", kVentTime + kSlack));
    EXPECT_EQ(rig_.safety.last().cause, "guard_lost") << rig_.safety.last().reason;
    EXPECT_LT(regulator_.pressure().maxCoeff(), kEmpty);
    const auto others = [&] {
      std::vector<pid_t> guards = guardsOf(regulator_.scene());
      guards.erase(std::remove(guards.begin(), guards.end(), first[0]), guards.end());
      return guards;
    };
    EXPECT_TRUE(waitFor([&] { return others().size() == 1; }));
    EXPECT_TRUE(rig_.bringTo(kPressures)) << rig_.safety.last().reason;
    // One that stood still wakes up, and finds that it is no longer the guard.
    kill(first[0], SIGCONT);
    EXPECT_TRUE(waitFor([&] { return guardsOf(regulator_.scene()) == others(); }));
    EXPECT_EQ(others().size(), 1u);
    EXPECT_FALSE(has(rig_.node.outputNow(), "guard: ")) << "the first one has vented";
    EXPECT_TRUE(rig_.bringTo(kPressures)) << rig_.safety.last().reason;
  }

  EmulatedRegulator regulator_{GetParam()};
  HardwareRig rig_{regulator_, nameOf(GetParam())};
};
INSTANTIATE_TEST_SUITE_P(, DeadParts, ::testing::ValuesIn(linesBySize(Line::kModbus)), nameOfLine);

TEST_P(DeadParts, ASilentCommanderVentsTheArm) {
  rig_.fallSilent();
  ASSERT_TRUE(rig_.ventsBy(rig_.lastTarget(), kTargetTimeout + kSlack));
  tellFigure("commander silent", rig_.lastTarget());
  EXPECT_GT(regulator::steadyNow() - rig_.lastTarget(), kTargetTimeout);
  ASSERT_TRUE(rig_.comesTo("vented"));
  EXPECT_EQ(rig_.safety.last().cause, "stale_target");
  EXPECT_TRUE(has(rig_.safety.last().reason, "target_timeout_s"));
  // After its return it moves nothing until the arm is enabled.
  rig_.command(kPressures);
  rig_.expectNothingMovesUntilEnabled(kPressures);
}

TEST_P(DeadParts, AVentIsARequestAndTheEmergencyStopIsLatched) {
  const double asked = regulator::steadyNow();
  EXPECT_TRUE(rig_.trigger(names::kVent).success);
  ASSERT_TRUE(rig_.ventsBy(asked, kAtOnce + kSlack));
  ASSERT_TRUE(rig_.comesTo("vented"));
  EXPECT_EQ(rig_.safety.last().cause, "vent_requested");
  ASSERT_TRUE(rig_.bringTo(kPressures)) << rig_.node.output();
  const double begin = regulator::steadyNow();
  const auto stopped = rig_.stop(true);
  EXPECT_TRUE(stopped.success);
  ASSERT_TRUE(rig_.ventsBy(begin, kAtOnce + kSlack));
  tellFigure("emergency stop", begin);
  ASSERT_TRUE(rig_.comesTo("vented"));
  EXPECT_EQ(rig_.safety.last().cause, "emergency_stop");
  EXPECT_TRUE(rig_.safety.last().stopped);
  const auto refused = rig_.trigger(names::kEnable);
  EXPECT_FALSE(refused.success);
  EXPECT_TRUE(has(refused.message, "emergency"));
  EXPECT_TRUE(rig_.stop(false).success);
  EXPECT_TRUE(waitFor([&] { return !rig_.safety.last().stopped; }));
  EXPECT_EQ(rig_.safety.last().state, "vented");
  EXPECT_TRUE(regulator_.isVented());
  EXPECT_TRUE(rig_.bringTo(kPressures));
}

TEST_P(DeadParts, AKilledNodeLeavesAGuardThatVents) {
  const double begin = regulator::steadyNow();
  rig_.node.signal(SIGKILL);
  ASSERT_TRUE(deviceVents(kAtOnce));
  tellFigure("node killed", begin);
  EXPECT_EQ(rig_.node.exitCode(), 128 + SIGKILL);
  expectEmpties();
}

TEST_P(DeadParts, AStoppedNodeIsKilledByItsGuardWhichVents) {
  const double begin = regulator::steadyNow();
  rig_.node.signal(SIGSTOP);
  ASSERT_TRUE(deviceVents(kStandstill));
  tellFigure("node stopped", begin);
  EXPECT_EQ(rig_.node.exitCode(), 128 + SIGKILL);
  expectEmpties();
}

TEST_P(DeadParts, ANodeThatIsAskedToEndVentsFirst) {
  const double begin = regulator::steadyNow();
  rig_.node.signal(SIGINT);
  ASSERT_TRUE(deviceVents(kAtOnce));
  tellFigure("node interrupted", begin);
  EXPECT_EQ(rig_.node.exitCode(), 0) << rig_.node.output();
  // What has lost its link may keep what is in it.
  EXPECT_LT(regulator_.pressure().maxCoeff(), kEmpty);
}

TEST_P(DeadParts, AKilledGuardVentsTheArmAndIsReplaced) {
  expectAnotherGuardAfter(SIGKILL, kGuardLooks);
}

TEST_P(DeadParts, AStoppedGuardVentsTheArmAndIsReplaced) {
  expectAnotherGuardAfter(SIGSTOP, kStandstill + kGuardLooks);
}

// Two faults at once: if the node were killed now, nothing could vent the arm.
TEST_P(DeadParts, WhileNoGuardCanBeStartedNothingIsEnabled) {
  const std::string scene = regulator_.scene(), hidden = scene + ".hidden";
  const std::vector<pid_t> first = guardsOf(scene);
  ASSERT_EQ(first.size(), 1u);
  std::filesystem::rename(scene, hidden);
  ASSERT_EQ(kill(first[0], SIGKILL), 0);
  ASSERT_TRUE(rig_.comesTo("vented")) << rig_.safety.last().reason;
  EXPECT_EQ(rig_.safety.last().cause, "guard_lost") << rig_.safety.last().reason;
  // Its targets go on; every look of the node starts a guard that ends at once.
  const int kLooks = 2, before = guardsStarted();
  // A busy machine may also miss the device for a moment, which is then the reason.
  std::string refusal;
  const std::string guard = "the guard, which vents the arm if this process is killed";
  bool enabled = false, inflated = false;
  EXPECT_TRUE(waitFor([&] {
    const auto answer = rig_.trigger(names::kEnable);
    enabled = enabled || answer.success;
    if (!answer.success && !has(refusal, guard)) refusal = answer.message;
    inflated = inflated || !regulator_.isVented();
    return guardsStarted() >= before + kLooks;
  })) << rig_.node.output();
  EXPECT_FALSE(enabled);
  EXPECT_FALSE(inflated);
  EXPECT_TRUE(has(refusal, guard));
  EXPECT_EQ(rig_.safety.last().state, "vented") << rig_.safety.last().reason;
  std::filesystem::rename(hidden, scene);
  EXPECT_TRUE(rig_.bringTo(kPressures)) << rig_.safety.last().reason;
  EXPECT_EQ(guardsOf(scene).size(), 1u);
}

// If node and guard die together, only the device itself can vent.
TEST(DeadMachine, ADeviceThatWatchesItsLineVentsByItself) {
  EmulatedRegulator regulator(Line::kSerial, EmulatedRegulator::Extra::kWatchdog);
  HardwareRig rig(regulator, "machine");
  ASSERT_TRUE(rig.bringTo(kPressures)) << rig.node.output();
  const std::vector<pid_t> guards = guardsOf(regulator.scene());
  ASSERT_EQ(guards.size(), 1u);
  // Stopped first: it is to see nothing of the node's end.
  ASSERT_EQ(kill(guards[0], SIGSTOP), 0);
  const double begin = regulator::steadyNow();
  rig.node.signal(SIGKILL);
  ASSERT_EQ(kill(guards[0], SIGKILL), 0);
  ASSERT_TRUE(rig.ventsBy(begin, kBoardWatchdog + kSlack));
  tellFigure("node and guard killed", begin);
  EXPECT_EQ(rig.node.exitCode(), 128 + SIGKILL);
  EXPECT_TRUE(
      eventually([&] { return regulator.pressure().maxCoeff() < kEmpty; }, kVentTime + kSlack));
}

// A regulator's node whose readings wait in some queue on their way, or whose clock is ahead.
TEST(DeadReadings, AReadingOnATopicIsAsOldAsItsStampSays) {
  ros::NodeHandle node("/old");
  Process command({HELIX_ARM_PRESSURE_COMMAND, "__ns:=/old", "_scene:=demo", "_regulator:=topic",
                   "_handle:=false"});
  Inbox<SafetyState> safety(node, names::kSafetyState);
  ros::Publisher publisher = node.advertise<PressureArray>(names::kPressureMeasured, 10);
  double age = 10;  // [s]
  const auto timer = node.createSteadyTimer(ros::WallDuration(0.02), [&](const auto&) {
    PressureArray reading;
    reading.header.stamp = ros::Time::now() - ros::Duration(age);
    reading.pressure = {0, 0, 0};
    publisher.publish(reading);
  });
  ros::NodeHandle services("/old/pressure_command");
  std_srvs::Trigger call;
  const auto enables = [&] {
    services.serviceClient<std_srvs::Trigger>(names::kEnable).call(call);
    return call.response.success;
  };
  ASSERT_TRUE(ros::service::waitForService("/old/pressure_command/enable", ros::Duration(20)));
  for (const double wrong : {10.0, -10.0}) {
    age = wrong;
    const char* const words = wrong > 0 ? "s ago, more than 0.5 s" : "s ahead of this machine's";
    EXPECT_TRUE(waitFor([&] { return command.outputNow().find(words) != std::string::npos; }))
        << command.output();
    EXPECT_FALSE(enables());
    EXPECT_TRUE(has(call.response.message, "has not been read yet"));
  }
  age = 0;
  EXPECT_TRUE(waitFor(enables)) << call.response.message;
  age = 10;
  EXPECT_TRUE(waitFor([&] { return safety.last().state == "fault"; }));
  EXPECT_EQ(safety.last().cause, "stale_reading");
}

// The arm of the demo, whose regulator is another node.
class DeadNodes : public ::testing::Test {
 protected:
  DeadNodes()
      : node_("/demo"),
        safety_(node_, names::kSafetyState),
        commands_(node_, names::kPressureCommand),
        measured_(node_, names::kPressureMeasured),
        command_(program(HELIX_ARM_PRESSURE_COMMAND, {"_regulator:=topic", "_auto_enable:=true"})),
        device_(program(HELIX_ARM_SIMULATED_RIG, {})),
        eyes_(program(HELIX_ARM_VISION, {"_source:=image/compressed"})),
        series_(program(HELIX_ARM_SERIES, {"_loop:=true", "_ramp_s:=0.2", "_hold_s:=1"})) {}

  void SetUp() override {
    ASSERT_TRUE(waitFor([this] { return !safety_.all().empty() && state() == "enabled"; }))
        << command_->output();
    ASSERT_TRUE(waitFor([this] { return highest() > 1e5; }));
  }

  static std::unique_ptr<Process> program(const char* path, std::vector<std::string> more) {
    more.insert(more.begin(), {path, "__ns:=/demo", "_scene:=demo"});
    return std::make_unique<Process>(more);
  }
  std::string state() const { return safety_.last().state; }
  double highest() const {
    const auto& all = measured_.all();
    return all.empty()
               ? 0
               : *std::max_element(all.back()->pressure.begin(), all.back()->pressure.end());
  }

  ros::NodeHandle node_;
  Inbox<SafetyState> safety_;
  Inbox<PressureArray> commands_, measured_;
  std::unique_ptr<Process> command_, device_, eyes_, series_;
};

TEST_F(DeadNodes, ARegulatorsNodeVentsByItselfWhereItsCommandsStop) {
  const double begin = regulator::steadyNow();
  command_->signal(SIGKILL);
  ASSERT_TRUE(device_->prints("the regulator vents by itself", kCommandTimeout + kSlack))
      << device_->output();
  tellFigure("node killed, regulator on a topic", begin);
  EXPECT_TRUE(waitFor([this] { return highest() < 3e4; }, kDemoVentTime + kSlack));
}

TEST_F(DeadNodes, AKilledRegulatorsNodeIsAFault) {
  device_->signal(SIGKILL);
  ASSERT_TRUE(waitFor([this] { return state() == "fault"; }, kDemoReadingTimeout + kSlack));
  EXPECT_EQ(safety_.last().cause, "stale_reading");
  const auto order = commands_.next([](const PressureArray&) { return true; });
  ASSERT_TRUE(order);
  EXPECT_EQ(order->pressure, (std::vector<double>{0, 0, 0}));
  // The pressure is unknown, which is reported after a while.
  EXPECT_TRUE(waitFor([this] { return safety_.last().vent_overdue; }, kDemoVentTime + kSlack));
  device_ = program(HELIX_ARM_SIMULATED_RIG, {});
  EXPECT_TRUE(waitFor([this] { return state() != "fault"; }));
}

TEST_F(DeadNodes, DeadEyesLeaveTheArmWhereItIs) {
  Inbox<ArmShape> measured(node_, names::kMeasured);
  ASSERT_TRUE(waitFor([&] { return !measured.all().empty(); }));
  eyes_->signal(SIGKILL);
  ASSERT_EQ(eyes_->exitCode(), 128 + SIGKILL);
  // The commands go on for longer than any rule lets the dead live.
  const std::size_t commands = commands_.all().size();
  ASSERT_TRUE(waitFor([&] { return commands_.all().size() > commands + 200; }));
  EXPECT_EQ(state(), "enabled");
}

}  // namespace
}  // namespace helix_arm::test
