// The fault matrix of the regulators and of the air behind them: what goes wrong, which state the
// arm comes to and within which time.
#include <cmath>
#include <set>

#include "support/hardware_rig.hpp"

namespace helix_arm::test {
namespace {

using simulation::DeviceFault;
using Causes = std::set<std::string>;

const Eigen::Vector3d kBefore(1.5e5, 1e5, 5e4);  // [Pa]
const Eigen::Vector3d kAfter(2e5, 0.5e5, 1.2e5);
constexpr double kAtOnce = 0;
constexpr double kOffCourse = kLag + kFollowTime;  // until a channel counts as not following [s]
constexpr double kOverfull = kLag + kSpikeTime;    // until one fills, and counts as over or full
constexpr double kHealed = 20;                     // for what comes once the fault is over [s]
// A round of requests and orders without answers: three channels of the profile `generic` [s].
constexpr double kRound = 2 * 3 * 0.1;
// Until the link is tried again [s].
const double kBackOff = regulator::IoRules().longest_back_off;

// One device and one node a line, for all tests of a suite.
class FaultMatrix : public ::testing::Test {
 protected:
  using Extra = EmulatedRegulator::Extra;

  FaultMatrix(Line line, Extra extra) : rig_(on(line, extra)) {}
  static void TearDownTestSuite() { pairs_.clear(); }

  void SetUp() override {
    ASSERT_TRUE(rig_.bringTo(kBefore)) << rig_.trigger(names::kEnable).message;
  }
  void TearDown() override { rig_.regulator.setFault(DeviceFault::kNone); }

  void begin(DeviceFault fault) {
    begin_ = regulator::steadyNow();
    rig_.regulator.setFault(fault);
  }
  double sinceBegin() const { return regulator::steadyNow() - begin_; }

  static void tell(const std::string& what, const std::string& cause, double to_fault,
                   double to_vent, const char* note = "") {
    std::printf("[  FIGURE  ] %s: %s after %.0f ms, the device vents after %.0f ms%s\n",
                what.c_str(), cause.c_str(), 1e3 * to_fault, 1e3 * to_vent, note);
  }

  HardwareRig& rig_;
  double begin_ = 0;  // of the fault, of regulator::steadyNow() [s]

 private:
  struct Pair {
    Pair(Line line, Extra extra) : regulator(line, extra), rig(regulator, nameOf(line)) {}
    EmulatedRegulator regulator;
    HardwareRig rig;
  };
  static HardwareRig& on(Line line, Extra extra) {
    auto& pair = pairs_[line];
    if (!pair) pair = std::make_unique<Pair>(line, extra);
    return pair->rig;
  }
  static inline std::map<Line, std::unique_ptr<Pair>> pairs_;
};

struct Row {
  Line line;
  DeviceFault fault;
  Causes causes;      ///< any of them: it depends on which rule is the first to see it
  double rule;        ///< what the slowest of them allows [s]
  bool vents = true;  ///< while the fault lasts: orders come in, and the link that it needs stands
};

class DeviceFaults : public FaultMatrix, public ::testing::WithParamInterface<Row> {
 protected:
  DeviceFaults() : FaultMatrix(GetParam().line, Extra::kNone) {}
};

TEST_P(DeviceFaults, EndVentedAndNothingMovesUntilEnabledAgain) {
  const Row& row = GetParam();
  begin(row.fault);
  rig_.command(kAfter);
  const std::size_t before = rig_.safety.all().size();
  ASSERT_TRUE(waitFor([&] { return rig_.safety.all().size() > before; }, row.rule + kSlack));
  const double to_fault = sinceBegin();
  const SafetyState fault = *rig_.safety.all().at(before);
  EXPECT_EQ(fault.state, "fault");
  EXPECT_TRUE(row.causes.count(fault.cause)) << fault.cause << ": " << fault.reason;

  // A device that cannot vent receives the order as soon as it can.
  if (row.vents) {
    EXPECT_TRUE(rig_.ventsBy(begin_, row.rule + kRound + kSlack));
  } else {
    const double healed = regulator::steadyNow();
    rig_.regulator.setFault(DeviceFault::kNone);
    EXPECT_TRUE(rig_.ventsBy(healed, kBackOff + kRound + kSlack));
  }
  const double to_vent = sinceBegin();
  rig_.regulator.setFault(DeviceFault::kNone);
  EXPECT_TRUE(rig_.comesTo("vented")) << rig_.safety.last().reason;
  EXPECT_EQ(rig_.safety.last().cause, fault.cause);
  EXPECT_LT(rig_.regulator.pressure().maxCoeff(), kEmpty);
  tell(::testing::UnitTest::GetInstance()->current_test_info()->name(), fault.cause, to_fault,
       to_vent, row.vents ? "" : " (it had to be mended first)");
  rig_.expectNothingMovesUntilEnabled(kBefore);
}

std::vector<Row> rows() {
  const Causes line = {"stale_reading", "regulator_lost"}, reading = {"not_following", "leak"};
  std::vector<Row> out;
  for (const Line on : linesBySize(Line::kSerial)) {
    const bool is_told = kindOf(on).names_unit;
    out.insert(out.end(), {{on, DeviceFault::kWrongUnit, is_told ? line : reading,
                            is_told ? kReadingTimeout : kOffCourse},
                           {on, DeviceFault::kSilence, line, kReadingTimeout, false},
                           {on, DeviceFault::kGarbage, line, kReadingTimeout},
                           {on, DeviceFault::kHalfLine, line, kReadingTimeout},
                           {on, DeviceFault::kSlow, line, kReadingTimeout},
                           {on, DeviceFault::kRestart, line, kAtOnce},
                           {on, DeviceFault::kNanText, line, kReadingTimeout},
                           {on, DeviceFault::kStuckValue, reading, kOffCourse}});
  }
  return out;
}
INSTANTIATE_TEST_SUITE_P(, DeviceFaults, ::testing::ValuesIn(rows()), [](const auto& row) {
  return nameOf(row.param.line) + "_" + simulation::nameOf(row.param.fault);
});

class AirFaults : public FaultMatrix, public ::testing::WithParamInterface<Line> {
 protected:
  AirFaults() : FaultMatrix(GetParam(), Extra::kSupplySensor) {}

  // What the arm was last said to be, once it is in this state.
  SafetyState inState(const std::string& state, double rule) {
    EXPECT_TRUE(rig_.comesTo(state, rule + kSlack))
        << state << " instead of " << rig_.safety.last().state;
    return rig_.safety.last();
  }
  void expectFault(DeviceFault fault, const std::string& cause, const std::string& culprit,
                   double rule) {
    begin(fault);
    const SafetyState told = inState("fault", rule);
    const double to_fault = sinceBegin();
    EXPECT_EQ(told.cause, cause) << told.reason;
    EXPECT_NE(told.reason.find(culprit), std::string::npos) << told.reason;
    ASSERT_TRUE(rig_.ventsBy(begin_, rule + kSlack));
    tell(simulation::nameOf(fault), told.cause, to_fault, sinceBegin());
  }
  bool isOverdue() {
    return waitFor([this] { return rig_.safety.last().vent_overdue; }, kVentTime + kSlack);
  }
  void expectRecovery() {
    rig_.regulator.setFault(DeviceFault::kNone);
    inState("vented", kHealed);
    rig_.expectNothingMovesUntilEnabled(kBefore);
  }
};
INSTANTIATE_TEST_SUITE_P(, AirFaults, ::testing::ValuesIn(linesBySize(Line::kSerial)), nameOfLine);

TEST_P(AirFaults, ABurstMuscleIsALeak) {
  expectFault(DeviceFault::kBurst, "leak", "muscle_1", kSpikeTime);
  inState("vented", kVentTime);  // no pressure stands, but it has burst all the same
  // Enabled without being mended, it is found out again. A busy machine may miss an answer first.
  SafetyState again;
  for (int attempt = 0; attempt < 5; ++attempt) {
    ASSERT_TRUE(waitFor([this] { return rig_.trigger(names::kEnable).success; }));
    again = inState("fault", kOffCourse);
    if (again.cause != "regulator_lost") break;
  }
  EXPECT_EQ(again.cause, "not_following") << again.reason;
  EXPECT_NE(again.reason.find("muscle_1"), std::string::npos) << again.reason;
  expectRecovery();
}

TEST_P(AirFaults, AnInletThatStaysOpenIsOverTheLimit) {
  expectFault(DeviceFault::kStuckOpen, "over_limit", "muscle_1", kOverfull);
  // Nothing that is ordered lets this air out, and it is said so.
  EXPECT_TRUE(isOverdue());
  EXPECT_TRUE(has(rig_.safety.last().reason, "shut the supply"));
  EXPECT_EQ(rig_.safety.last().state, "fault");
  EXPECT_FALSE(rig_.trigger(names::kEnable).success);
  expectRecovery();
}

TEST_P(AirFaults, AValveThatStaysShutDoesNotFollow) {
  rig_.command(kAfter);
  expectFault(DeviceFault::kStuckShut, "not_following", "muscle_1", kOffCourse);
  EXPECT_TRUE(isOverdue());
  expectRecovery();
}

TEST_P(AirFaults, AWeakSupplyIsOne) {
  expectFault(DeviceFault::kLowSupply, "low_supply", "min_supply_kpa", kSpikeTime);
  inState("vented", kVentTime);
  const auto refused = rig_.trigger(names::kEnable);
  EXPECT_FALSE(refused.success);
  EXPECT_NE(refused.message.find("min_supply_kpa"), std::string::npos) << refused.message;
  expectRecovery();
}

TEST_P(AirFaults, PressureInAVentedArmIsAFault) {
  ASSERT_TRUE(rig_.trigger(names::kVent).success);
  inState("vented", kVentTime);
  rig_.regulator.setFault(DeviceFault::kStuckOpen);
  const SafetyState told = inState("fault", kOverfull);
  EXPECT_EQ(told.cause, "not_venting") << told.reason;
  EXPECT_NE(told.reason.find("muscle_1"), std::string::npos) << told.reason;
  expectRecovery();
}

}  // namespace
}  // namespace helix_arm::test
