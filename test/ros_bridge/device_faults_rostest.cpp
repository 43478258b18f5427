// The fault matrix of the regulators: what an emulated device does wrong, which state the arm comes
// to and within which time.
#include <array>
#include <cmath>
#include <cstdio>
#include <set>

#include <gtest/gtest.h>

#include "support/hardware_rig.hpp"

namespace helix_arm::test {
namespace {

using simulation::DeviceFault;
using Line = EmulatedRegulator::Line;
using Causes = std::set<std::string>;

const Eigen::Vector3d kBefore(1.5e5, 1e5, 5e4);  // [Pa]
const Eigen::Vector3d kAfter(2e5, 0.5e5, 1.2e5);
// A round of requests and orders without answers: three channels of the profile `generic` [s].
constexpr double kRound = 2 * 3 * 0.1;
// Until the link is tried again [s].
const double kBackOff = regulator::IoRules().longest_back_off;

struct Row {
  Line line;
  DeviceFault fault;
  Causes causes;      ///< any of them: it depends on which rule is the first to see it
  double rule;        ///< what the slowest of them allows [s]
  bool vents = true;  ///< while the fault lasts: orders come in, and the link that it needs stands
};

std::string nameOfRow(const ::testing::TestParamInfo<Row>& info) {
  return std::string(info.param.line == Line::kSerial ? "Serial_" : "Modbus_") +
         simulation::nameOf(info.param.fault);
}

// One device and one node a line, for all rows.
class Rigs : public ::testing::Environment {
 public:
  struct Pair {
    explicit Pair(Line line)
        : regulator(line), rig(regulator, line == Line::kSerial ? "serial" : "modbus") {}
    EmulatedRegulator regulator;
    HardwareRig rig;
  };
  static HardwareRig& on(Line line) {
    auto& pair = pairs_[static_cast<std::size_t>(line)];
    if (!pair) pair = std::make_unique<Pair>(line);
    return pair->rig;
  }
  void TearDown() override {
    for (auto& pair : pairs_) pair.reset();
  }

 private:
  static std::array<std::unique_ptr<Pair>, 2> pairs_;
};
std::array<std::unique_ptr<Rigs::Pair>, 2> Rigs::pairs_;

class DeviceFaults : public ::testing::TestWithParam<Row> {
 protected:
  void TearDown() override { rig_.regulator.setFault(DeviceFault::kNone); }

  HardwareRig& rig_ = Rigs::on(GetParam().line);
};

TEST_P(DeviceFaults, EndVentedAndNothingMovesUntilEnabledAgain) {
  const Row& row = GetParam();
  ASSERT_TRUE(rig_.bringTo(kBefore)) << rig_.node.output();

  const double begin = regulator::steadyNow();
  rig_.regulator.setFault(row.fault);
  rig_.command(kAfter);
  const std::size_t before = rig_.safety.all().size();
  ASSERT_TRUE(waitFor([&] { return rig_.safety.all().size() > before; }, row.rule + kSlack));
  const double to_fault = regulator::steadyNow() - begin;
  const SafetyState fault = *rig_.safety.all().at(before);
  EXPECT_EQ(fault.state, "fault");
  EXPECT_TRUE(row.causes.count(fault.cause)) << fault.cause << ": " << fault.reason;

  // A device that cannot vent receives the order as soon as it can.
  if (row.vents) {
    EXPECT_TRUE(rig_.ventsBy(begin, row.rule + kRound + kSlack));
  } else {
    const double healed = regulator::steadyNow();
    rig_.regulator.setFault(DeviceFault::kNone);
    EXPECT_TRUE(rig_.ventsBy(healed, kBackOff + kRound + kSlack));
  }
  const double to_vent = regulator::steadyNow() - begin;
  rig_.regulator.setFault(DeviceFault::kNone);
  EXPECT_TRUE(rig_.comesTo("vented")) << rig_.safety.last().reason;
  EXPECT_EQ(rig_.safety.last().cause, fault.cause);
  EXPECT_LT(rig_.regulator.pressure().maxCoeff(), kEmpty);
  std::printf("[  FIGURE  ] %s: %s after %.0f ms, the device vents after %.0f ms%s\n",
              ::testing::UnitTest::GetInstance()->current_test_info()->name(), fault.cause.c_str(),
              1e3 * to_fault, 1e3 * to_vent, row.vents ? "" : " (it had to be mended first)");

  RecordProperty("cause", fault.cause);
  RecordProperty("fault_after_ms", std::to_string(std::lround(1e3 * to_fault)));
  RecordProperty("vents_after_ms", std::to_string(std::lround(1e3 * to_vent)));

  // The commander continues all the time.
  const std::size_t answers = rig_.status.all().size();
  ASSERT_TRUE(waitFor([&] { return rig_.status.all().size() >= answers + 10; }));
  EXPECT_EQ(rig_.status.last().fault, "not_enabled");
  EXPECT_TRUE(rig_.regulator.isVented());
  EXPECT_TRUE(rig_.bringTo(kBefore)) << rig_.safety.last().reason;
}

const Causes kLine = {"stale_reading", "regulator_lost"};
const Causes kReading = {"not_following", "leak"};
constexpr double kAtOnce = 0;
constexpr double kOffCourse = kLag + kFollowTime;

INSTANTIATE_TEST_SUITE_P(
    , DeviceFaults,
    ::testing::Values(Row{Line::kSerial, DeviceFault::kWrongUnit, kLine, kReadingTimeout},
                      Row{Line::kSerial, DeviceFault::kSilence, kLine, kReadingTimeout, false},
                      Row{Line::kSerial, DeviceFault::kGarbage, kLine, kReadingTimeout},
                      Row{Line::kSerial, DeviceFault::kHalfLine, kLine, kReadingTimeout},
                      Row{Line::kSerial, DeviceFault::kSlow, kLine, kReadingTimeout},
                      Row{Line::kSerial, DeviceFault::kRestart, kLine, kAtOnce},
                      Row{Line::kSerial, DeviceFault::kNanText, kLine, kReadingTimeout},
                      Row{Line::kSerial, DeviceFault::kStuckValue, kReading, kOffCourse},
                      Row{Line::kModbus, DeviceFault::kSilence, kLine, kReadingTimeout, false},
                      Row{Line::kModbus, DeviceFault::kGarbage, kLine, kReadingTimeout},
                      Row{Line::kModbus, DeviceFault::kHalfLine, kLine, kReadingTimeout},
                      Row{Line::kModbus, DeviceFault::kWrongUnit, kReading, kOffCourse},
                      Row{Line::kModbus, DeviceFault::kSlow, kLine, kReadingTimeout},
                      Row{Line::kModbus, DeviceFault::kRestart, kLine, kAtOnce},
                      Row{Line::kModbus, DeviceFault::kNanText, kLine, kReadingTimeout},
                      Row{Line::kModbus, DeviceFault::kStuckValue, kReading, kOffCourse}),
    nameOfRow);

}  // namespace
}  // namespace helix_arm::test

int main(int argc, char** argv) {
  ::testing::AddGlobalTestEnvironment(new helix_arm::test::Rigs);
  return helix_arm::test::runRostest(argc, argv);
}
