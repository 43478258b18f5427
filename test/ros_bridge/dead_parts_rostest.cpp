// The fault matrix of what is around the regulator: commander, node, rig and eyes die, and the arm
// comes to the state that is said of it within the time that is said of it.
#include <cmath>
#include <csignal>
#include <cstdio>
#include <limits>

#include <gtest/gtest.h>

#include "support/hardware_rig.hpp"

namespace helix_arm::test {
namespace {

using Line = EmulatedRegulator::Line;

const Eigen::Vector3d kPressures(1.5e5, 1e5, 5e4);  // [Pa]
constexpr double kTargetTimeout = 0.5;              // of the scene [s]
constexpr double kHang = 5;                         // longer than any rule, and a busy machine [s]

void tellFigure(const char* what, double since) {
  const double after = regulator::steadyNow() - since;
  std::printf("[  FIGURE  ] %s: the regulator vents after %.0f ms\n", what, 1e3 * after);
  ::testing::Test::RecordProperty("vents_after_ms", std::to_string(std::lround(1e3 * after)));
}

class DeadParts : public ::testing::TestWithParam<Line> {
 protected:
  void SetUp() override { ASSERT_TRUE(rig_.bringTo(kPressures)) << rig_.node.output(); }

  bool deviceVents(double deadline) {
    return waitFor([this] { return regulator_.vents(); }, deadline);
  }

  EmulatedRegulator regulator_{GetParam()};
  HardwareRig rig_{regulator_, GetParam() == Line::kSerial ? "serial" : "modbus"};
};
std::string nameOfLine(const ::testing::TestParamInfo<Line>& line) {
  return line.param == Line::kSerial ? "Serial" : "Modbus";
}
INSTANTIATE_TEST_SUITE_P(, DeadParts, ::testing::Values(Line::kSerial, Line::kModbus), nameOfLine);

TEST_P(DeadParts, ASilentCommanderVentsTheArm) {
  rig_.fallSilent();
  ASSERT_TRUE(deviceVents(kHang));
  tellFigure("commander silent", rig_.lastTarget());
  EXPECT_GT(regulator::steadyNow() - rig_.lastTarget(), kTargetTimeout);
  ASSERT_TRUE(rig_.comesTo("vented"));
  EXPECT_EQ(rig_.safety.last().cause, "stale_target");
  EXPECT_NE(rig_.safety.last().reason.find("target_timeout_s"), std::string::npos)
      << rig_.safety.last().reason;
  // Back again, it moves nothing until somebody has enabled the arm.
  const std::size_t answers = rig_.status.all().size();
  rig_.command(kPressures);
  ASSERT_TRUE(waitFor([&] { return rig_.status.all().size() >= answers + 10; }));
  EXPECT_EQ(rig_.status.last().fault, "not_enabled");
  EXPECT_TRUE(regulator_.vents());
  EXPECT_TRUE(rig_.bringTo(kPressures));
}

TEST_P(DeadParts, ACommanderThatTalksNonsenseIsASilentOne) {
  rig_.command(Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()));
  ASSERT_TRUE(deviceVents(kHang));
  ASSERT_TRUE(rig_.comesTo("vented"));
  EXPECT_EQ(rig_.safety.last().cause, "stale_target");
}

TEST_P(DeadParts, TheEmergencyStopIsLatched) {
  const double begin = regulator::steadyNow();
  const auto stopped = rig_.stop(true);
  EXPECT_TRUE(stopped.success);
  ASSERT_TRUE(deviceVents(kHang));
  tellFigure("emergency stop", begin);
  ASSERT_TRUE(rig_.comesTo("vented"));
  EXPECT_EQ(rig_.safety.last().cause, "emergency_stop");
  EXPECT_TRUE(rig_.safety.last().stopped);
  const auto refused = rig_.trigger(names::kEnable);
  EXPECT_FALSE(refused.success);
  EXPECT_NE(refused.message.find("emergency"), std::string::npos) << refused.message;
  EXPECT_TRUE(rig_.stop(false).success);
  EXPECT_TRUE(waitFor([&] { return !rig_.safety.last().stopped; }));
  EXPECT_EQ(rig_.safety.last().state, "vented");
  EXPECT_TRUE(regulator_.vents());
  EXPECT_TRUE(rig_.bringTo(kPressures));
}

TEST_P(DeadParts, AVentIsARequestAndNoFault) {
  const auto answer = rig_.trigger(names::kVent);
  EXPECT_TRUE(answer.success) << answer.message;
  ASSERT_TRUE(deviceVents(kHang));
  ASSERT_TRUE(rig_.comesTo("vented"));
  EXPECT_EQ(rig_.safety.last().cause, "vent_requested");
}

TEST_P(DeadParts, AKilledNodeLeavesAGuardThatVents) {
  const double begin = regulator::steadyNow();
  rig_.node.signal(SIGKILL);
  ASSERT_TRUE(deviceVents(kHang));
  tellFigure("node killed", begin);
  EXPECT_EQ(rig_.node.exitCode(), 128 + SIGKILL);
}

TEST_P(DeadParts, ANodeThatStandsStillIsKilledByItsGuardWhichVents) {
  const double begin = regulator::steadyNow();
  rig_.node.signal(SIGSTOP);
  ASSERT_TRUE(deviceVents(kHang));
  tellFigure("node stopped", begin);
  EXPECT_EQ(rig_.node.exitCode(), 128 + SIGKILL);
}

TEST_P(DeadParts, ANodeThatIsAskedToEndVentsFirst) {
  const double begin = regulator::steadyNow();
  rig_.node.signal(SIGINT);
  ASSERT_TRUE(deviceVents(kHang));
  tellFigure("node interrupted", begin);
  EXPECT_EQ(rig_.node.exitCode(), 0) << rig_.node.output();
}

TEST_P(DeadParts, AnotherCommanderIsRefusedWhileTheFirstHoldsTheLease) {
  const std::string ns = GetParam() == Line::kSerial ? "/serial" : "/modbus";
  Process second({HELIX_ARM_SERIES, "__ns:=" + ns, "_scene:=" + regulator_.scene()});
  ASSERT_TRUE(rig_.status.next([](const TargetStatus& s) { return s.fault == "other_commander"; }));
  EXPECT_EQ(rig_.safety.last().state, "enabled");
  EXPECT_LT((regulator_.pressure() - kPressures).cwiseAbs().maxCoeff(), 5e3);
}

// The arm of the demo, whose regulator is another node.
class DeadNodes : public ::testing::Test {
 protected:
  DeadNodes()
      : rig_("demo"),
        node_("/demo"),
        safety_(node_, names::kSafetyState),
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
    const auto& all = rig_.measured.all();
    return all.empty()
               ? 0
               : *std::max_element(all.back()->pressure.begin(), all.back()->pressure.end());
  }

  Rig rig_;
  ros::NodeHandle node_;
  Inbox<SafetyState> safety_;
  std::unique_ptr<Process> command_, device_, eyes_, series_;
};

TEST_F(DeadNodes, AKilledCommanderVentsTheArm) {
  series_->signal(SIGKILL);
  ASSERT_TRUE(waitFor([this] { return state() == "vented"; }, 5));
  EXPECT_EQ(safety_.last().cause, "stale_target");
}

TEST_F(DeadNodes, ARegulatorsNodeVentsByItselfWhereItsCommandsStop) {
  const double begin = regulator::steadyNow();
  command_->signal(SIGKILL);
  ASSERT_TRUE(device_->prints("the regulator vents by itself", 5)) << device_->output();
  tellFigure("node killed, regulator on a topic", begin);
  EXPECT_TRUE(waitFor([this] { return highest() < 3e4; }, 5));
}

TEST_F(DeadNodes, AKilledRegulatorsNodeIsAFault) {
  device_->signal(SIGKILL);
  ASSERT_TRUE(waitFor([this] { return state() == "fault"; }, 5));
  EXPECT_EQ(safety_.last().cause, "stale_reading");
  const auto order = rig_.command.next([](const PressureArray&) { return true; });
  ASSERT_TRUE(order);
  EXPECT_EQ(order->pressure, (std::vector<double>{0, 0, 0}));
  // What became of the pressure nobody can say, and after a while it is said so.
  EXPECT_TRUE(waitFor([this] { return safety_.last().vent_overdue; }, 10));
  device_ = program(HELIX_ARM_SIMULATED_RIG, {});
  EXPECT_TRUE(waitFor([this] { return state() != "fault"; }));
}

TEST_F(DeadNodes, DeadEyesLeaveTheArmWhereItIs) {
  Inbox<ArmShape> measured(node_, names::kMeasured);
  ASSERT_TRUE(waitFor([&] { return !measured.all().empty(); }));
  eyes_->signal(SIGKILL);
  ASSERT_EQ(eyes_->exitCode(), 128 + SIGKILL);
  // The commands go on for longer than any rule lets the dead live.
  const std::size_t commands = rig_.command.all().size();
  ASSERT_TRUE(waitFor([&] { return rig_.command.all().size() > commands + 200; }));
  EXPECT_EQ(state(), "enabled");
}

}  // namespace
}  // namespace helix_arm::test

int main(int argc, char** argv) { return helix_arm::test::runRostest(argc, argv); }
