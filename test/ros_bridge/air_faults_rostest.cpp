// The fault matrix of the air: what goes wrong behind a regulator that is well, which state the arm
// comes to and within which time.
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>

#include <gtest/gtest.h>

#include "support/hardware_rig.hpp"

namespace helix_arm::test {
namespace {

using simulation::DeviceFault;
using Line = EmulatedRegulator::Line;

const Eigen::Vector3d kPressures(1.5e5, 1e5, 5e4);  // [Pa]
const Eigen::Vector3d kOthers(2e5, 0.5e5, 1.2e5);
constexpr double kOffCourse = kLag + kFollowTime;  // until a channel counts as not following [s]
constexpr double kOverfull = kLag + kSpikeTime;    // until one fills, and counts as over or full
constexpr double kHealed = 20;                     // for what comes once the fault is over [s]

class AirFaults : public ::testing::TestWithParam<Line> {
 protected:
  void SetUp() override {
    ASSERT_TRUE(rig_.bringTo(kPressures)) << rig_.trigger(names::kEnable).message;
  }

  // What the arm was last said to be, once it is in this state.
  SafetyState inState(const std::string& state, double rule) {
    EXPECT_TRUE(rig_.comesTo(state, rule + kSlack))
        << state << " instead of " << rig_.safety.last().state;
    return rig_.safety.last();
  }

  void expectFault(DeviceFault fault, const std::string& cause, const std::string& culprit,
                   double rule) {
    const double begin = regulator::steadyNow();
    regulator_.setFault(fault);
    const SafetyState told = inState("fault", rule);
    const double to_fault = regulator::steadyNow() - begin;
    EXPECT_EQ(told.cause, cause) << told.reason;
    EXPECT_NE(told.reason.find(culprit), std::string::npos) << told.reason;
    ASSERT_TRUE(rig_.ventsBy(begin, rule + kSlack));
    const double to_vent = regulator::steadyNow() - begin;
    std::printf("[  FIGURE  ] %s: %s after %.0f ms, the device vents after %.0f ms\n",
                simulation::nameOf(fault), told.cause.c_str(), 1e3 * to_fault, 1e3 * to_vent);
    RecordProperty("fault_after_ms", std::to_string(std::lround(1e3 * to_fault)));
    RecordProperty("vents_after_ms", std::to_string(std::lround(1e3 * to_vent)));
  }
  bool isOverdue() {
    return waitFor([this] { return rig_.safety.last().vent_overdue; }, kVentTime + kSlack);
  }
  // The commander went on all the while.
  void expectNothingMovesUntilEnabled() {
    const std::size_t answers = rig_.status.all().size();
    ASSERT_TRUE(waitFor([&] { return rig_.status.all().size() >= answers + 10; }));
    EXPECT_EQ(rig_.status.last().fault, "not_enabled");
    EXPECT_TRUE(regulator_.isVented());
    EXPECT_TRUE(rig_.bringTo(kPressures)) << rig_.safety.last().reason;
  }

  EmulatedRegulator regulator_{GetParam(), EmulatedRegulator::Extra::kSupplySensor};
  HardwareRig rig_{regulator_, GetParam() == Line::kSerial ? "serial" : "modbus"};
};
std::string nameOfLine(const ::testing::TestParamInfo<Line>& line) {
  return line.param == Line::kSerial ? "Serial" : "Modbus";
}
INSTANTIATE_TEST_SUITE_P(, AirFaults, ::testing::Values(Line::kSerial, Line::kModbus), nameOfLine);

TEST_P(AirFaults, ABurstMuscleIsALeak) {
  expectFault(DeviceFault::kBurst, "leak", "muscle_1", kSpikeTime);
  inState("vented", kVentTime);  // no pressure stands, but it has burst all the same
  // Enabled without being mended, it is found out again.
  ASSERT_TRUE(rig_.trigger(names::kEnable).success);
  const SafetyState again = inState("fault", kOffCourse);
  EXPECT_EQ(again.cause, "not_following") << again.reason;
  EXPECT_NE(again.reason.find("muscle_1"), std::string::npos) << again.reason;
  regulator_.setFault(DeviceFault::kNone);
  inState("vented", kHealed);
  expectNothingMovesUntilEnabled();
}

TEST_P(AirFaults, AnInletThatStaysOpenIsOverTheLimit) {
  expectFault(DeviceFault::kStuckOpen, "over_limit", "muscle_1", kOverfull);
  // Nothing that is ordered lets this air out, and it is said so.
  EXPECT_TRUE(isOverdue());
  EXPECT_NE(rig_.safety.last().reason.find("shut the supply"), std::string::npos)
      << rig_.safety.last().reason;
  EXPECT_EQ(rig_.safety.last().state, "fault");
  EXPECT_FALSE(rig_.trigger(names::kEnable).success);
  regulator_.setFault(DeviceFault::kNone);
  inState("vented", kHealed);
  expectNothingMovesUntilEnabled();
}

TEST_P(AirFaults, AValveThatStaysShutDoesNotFollow) {
  rig_.command(kOthers);
  expectFault(DeviceFault::kStuckShut, "not_following", "muscle_1", kOffCourse);
  EXPECT_TRUE(isOverdue());
  regulator_.setFault(DeviceFault::kNone);
  inState("vented", kHealed);
  expectNothingMovesUntilEnabled();
}

TEST_P(AirFaults, AWeakSupplyIsOne) {
  expectFault(DeviceFault::kLowSupply, "low_supply", "min_supply_kpa", kSpikeTime);
  inState("vented", kVentTime);
  const auto refused = rig_.trigger(names::kEnable);
  EXPECT_FALSE(refused.success);
  EXPECT_NE(refused.message.find("min_supply_kpa"), std::string::npos) << refused.message;
  regulator_.setFault(DeviceFault::kNone);
  expectNothingMovesUntilEnabled();
}

TEST_P(AirFaults, PressureInAVentedArmIsAFault) {
  ASSERT_TRUE(rig_.trigger(names::kVent).success);
  inState("vented", kVentTime);
  regulator_.setFault(DeviceFault::kStuckOpen);
  const SafetyState told = inState("fault", kOverfull);
  EXPECT_EQ(told.cause, "not_venting") << told.reason;
  EXPECT_NE(told.reason.find("muscle_1"), std::string::npos) << told.reason;
  regulator_.setFault(DeviceFault::kNone);
  inState("vented", kHealed);
  expectNothingMovesUntilEnabled();
}

}  // namespace
}  // namespace helix_arm::test
