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
constexpr double kHang = 5;  // longer than any rule of the scene, and a busy machine [s]

struct Row {
  Line line;
  DeviceFault fault;
  Causes causes;      ///< any of them: it depends on which rule is the first to see it
  bool hears = true;  ///< the device still takes orders in
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

  // Seconds from now to the condition; a failure beyond the deadline.
  double timeTo(const std::function<bool()>& condition, double deadline, const char* what) {
    const double begin = regulator::steadyNow();
    EXPECT_TRUE(waitFor(condition, deadline)) << what << " not within " << deadline << " s";
    return regulator::steadyNow() - begin;
  }

  HardwareRig& rig_ = Rigs::on(GetParam().line);
};

TEST_P(DeviceFaults, EndVentedAndNothingMovesUntilEnabledAgain) {
  const Row& row = GetParam();
  ASSERT_TRUE(rig_.bringTo(kBefore)) << rig_.node.output();

  const double begin = regulator::steadyNow();
  rig_.regulator.setFault(row.fault);
  rig_.command(kAfter);
  const std::size_t before = rig_.safety.all().size();
  timeTo([&] { return rig_.safety.all().size() > before; }, kHang, "the fault");
  const double to_fault = regulator::steadyNow() - begin;
  const SafetyState fault = *rig_.safety.all().at(before);
  EXPECT_EQ(fault.state, "fault");
  EXPECT_TRUE(row.causes.count(fault.cause)) << fault.cause << ": " << fault.reason;

  // A device that is deaf is told as soon as it hears.
  if (!row.hears) rig_.regulator.setFault(DeviceFault::kNone);
  timeTo([&] { return rig_.regulator.vents(); }, kHang, "the vent");
  const double to_vent = regulator::steadyNow() - begin;
  rig_.regulator.setFault(DeviceFault::kNone);
  EXPECT_TRUE(rig_.comesTo("vented")) << rig_.safety.last().reason;
  EXPECT_EQ(rig_.safety.last().cause, fault.cause);
  std::printf("[  FIGURE  ] %s: %s after %.0f ms, the device vents after %.0f ms%s\n",
              ::testing::UnitTest::GetInstance()->current_test_info()->name(), fault.cause.c_str(),
              1e3 * to_fault, 1e3 * to_vent, row.hears ? "" : " (it had to hear again first)");

  RecordProperty("cause", fault.cause);
  RecordProperty("fault_after_ms", std::to_string(std::lround(1e3 * to_fault)));
  RecordProperty("vents_after_ms", std::to_string(std::lround(1e3 * to_vent)));

  // The commander goes on all the while.
  const std::size_t answers = rig_.status.all().size();
  ASSERT_TRUE(waitFor([&] { return rig_.status.all().size() >= answers + 10; }));
  EXPECT_EQ(rig_.status.last().fault, "not_enabled");
  EXPECT_TRUE(rig_.regulator.vents());
  EXPECT_TRUE(rig_.bringTo(kBefore)) << rig_.safety.last().reason;
}

const Causes kLine = {"stale_reading", "regulator_lost"};
const Causes kReading = {"not_following", "leak"};

INSTANTIATE_TEST_SUITE_P(, DeviceFaults,
                         ::testing::Values(Row{Line::kSerial, DeviceFault::kWrongUnit, kLine},
                                           Row{Line::kSerial, DeviceFault::kSilence, kLine, false},
                                           Row{Line::kSerial, DeviceFault::kGarbage, kLine},
                                           Row{Line::kSerial, DeviceFault::kHalfLine, kLine},
                                           Row{Line::kSerial, DeviceFault::kSlow, kLine},
                                           Row{Line::kSerial, DeviceFault::kRestart, kLine},
                                           Row{Line::kSerial, DeviceFault::kNanText, kLine},
                                           Row{Line::kSerial, DeviceFault::kStuckValue, kReading},
                                           Row{Line::kModbus, DeviceFault::kSilence, kLine, false},
                                           Row{Line::kModbus, DeviceFault::kGarbage, kLine},
                                           Row{Line::kModbus, DeviceFault::kHalfLine, kLine},
                                           Row{Line::kModbus, DeviceFault::kWrongUnit, kReading},
                                           Row{Line::kModbus, DeviceFault::kSlow, kLine},
                                           Row{Line::kModbus, DeviceFault::kRestart, kLine},
                                           Row{Line::kModbus, DeviceFault::kNanText, kLine},
                                           Row{Line::kModbus, DeviceFault::kStuckValue, kReading}),
                         nameOfRow);

}  // namespace
}  // namespace helix_arm::test

int main(int argc, char** argv) {
  ::testing::AddGlobalTestEnvironment(new helix_arm::test::Rigs);
  return helix_arm::test::runRostest(argc, argv);
}
