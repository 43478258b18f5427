// Two programs that use one device: the second is told which process has it, and the first is not
// disturbed.
#include <csignal>

#include <gtest/gtest.h>

#include "command.hpp"
#include "helix_arm/simulation/emulated_device.hpp"
#include "support/eventually.hpp"
#include "support/modbus_profiles.hpp"
#include "support/process.hpp"

namespace helix_arm::test {
namespace {

using simulation::EmulatedDevice;

constexpr double kSet = 1e5;  // [Pa]

class RegulatorLock : public ::testing::Test {
 protected:
  RegulatorLock() : device_(deviceConfig()) {}

  static simulation::ModbusDeviceConfig deviceConfig() {
    simulation::ModbusDeviceConfig config = quietDevice(vtemProfile(), 4);
    config.regulator.time_constant = 0.05;
    return config;
  }
  std::vector<std::string> call(std::vector<std::string> action) const {
    action.insert(action.begin(), {"regulator", scenePath("demo_modbus")});
    action.insert(action.end(),
                  {"--set", "regulator.modbus_tcp.port=" + std::to_string(device_.port())});
    return action;
  }
  std::vector<std::string> set(const std::string& seconds) const {
    return call({"set", "--yes", "--pressure-kpa", "100,100,100", "--seconds", seconds});
  }
  bool stands() const { return device_.pressure().head(3).minCoeff() > 0.95 * kSet; }

  EmulatedDevice device_;
};

TEST_F(RegulatorLock, TheSecondLearnsWhoHasTheDeviceAndTheFirstContinues) {
  std::vector<std::string> words = set("600");
  words.insert(words.begin(), HELIX_ARM_COMMAND);
  Process first(words);
  ASSERT_TRUE(eventually([this] { return stands(); }, 30.0)) << first.outputNow();
  for (const std::vector<std::string>& second :
       {set("0.1"), call({"vent"}), call({"probe", "--seconds", "0.1"})}) {
    const Outcome outcome = runCommand(second);
    EXPECT_EQ(outcome.exit_code, 1) << outcome.out;
    EXPECT_NE(outcome.err.find(" is driven by process "), std::string::npos) << outcome.err;
    EXPECT_NE(outcome.err.find("(helix_arm); end that one first"), std::string::npos)
        << outcome.err;
    EXPECT_TRUE(stands()) << "after " << second[2];
  }
  // When it is killed, its guard vents and the device is free for the next program.
  first.signal(SIGKILL);
  EXPECT_TRUE(eventually([this] { return device_.pressure().maxCoeff() < 0.15 * kSet; }, 30.0));
  EXPECT_TRUE(eventually([this] { return runCommand(call({"vent"})).exit_code == 0; }, 30.0));
}

}  // namespace
}  // namespace helix_arm::test
