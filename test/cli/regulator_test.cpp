#include <algorithm>
#include <csignal>

#include <gtest/gtest.h>
#include <unistd.h>

#include "command.hpp"
#include "simulation/emulated_device.hpp"
#include "support/eventually.hpp"
#include "support/modbus_profiles.hpp"
#include "support/process.hpp"

namespace helix_arm::test {
namespace {

constexpr double kEmpty = 1.5e4;  // safety.vented_below_kpa by default [Pa]

using control::Valve;
using simulation::DeviceFault;
using simulation::EmulatedDevice;

simulation::EmulatedDeviceConfig deviceConfig() {
  simulation::EmulatedDeviceConfig config = quietDevice(vtemProfile(), 4);
  config.valves.time_constant = 0.05;
  return config;
}

// The shipped demo of a Modbus device, with the port of an emulated one.
std::vector<std::string> at(int port, std::vector<std::string> more) {
  more.insert(more.begin(), {"regulator", scenePath("demo_modbus")});
  more.insert(more.end(), {"--set", "regulator.modbus_tcp.port=" + std::to_string(port)});
  return more;
}

Outcome run(int port, const std::vector<std::string>& more) { return runCommand(at(port, more)); }

// Pressure in all channels, and no program that holds them.
void fill(const EmulatedDevice& device) {
  const auto driver =
      regulator::ModbusConfig{vtemProfile(), "127.0.0.1", device.port(), {0, 1, 2}}.makeDriver(3);
  driver->connect();
  control::ValveOrders orders(3);
  orders.valve.assign(3, Valve::kRegulate);
  orders.set_point.setConstant(2e5);
  driver->write(orders);
  ASSERT_TRUE(eventually([&] { return device.pressure().head(3).minCoeff() > 1.9e5; }));
}

double fullest(const EmulatedDevice& device) { return device.pressure().maxCoeff(); }

// The command as a process, of these arguments.
std::vector<std::string> words(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), HELIX_ARM_COMMAND);
  return arguments;
}

// A process that brings the arm there and stays.
std::vector<std::string> setsForLong(const EmulatedDevice& device,
                                     const std::string& kpa = "100,0,50") {
  return words(at(device.port(), {"set", "--pressure-kpa", kpa, "--seconds", "1000", "--yes"}));
}

TEST(RegulatorProbe, ReportsWhichChannelsAnswerAndHowOften) {
  EmulatedDevice device(deviceConfig());
  const Outcome outcome = run(device.port(), {"probe", "--seconds", "0.3", "--format", "json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(outcome.err, "");
  const nlohmann::json result = outcome.json();
  ASSERT_EQ(result["channels"].size(), 3u);
  for (int i = 0; i < 3; ++i) {
    const nlohmann::json& channel = result["channels"][i];
    EXPECT_EQ(channel["name"], "muscle_" + std::to_string(i + 1));
    EXPECT_EQ(channel["address"], std::to_string(i));
    EXPECT_EQ(channel["pressure_pa"], 0.0);
    EXPECT_GT(channel["readings"].get<int>(), 0);
  }
  EXPECT_EQ(device.taken(), 3u);  // what connecting takes, no more
}

TEST(RegulatorSet, GoesThereAndVents) {
  EmulatedDevice device(deviceConfig());
  const Outcome outcome = run(device.port(), {"set", "--pressure-kpa", "100,0,50", "--seconds",
                                              "1.5", "--yes", "--format", "json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const nlohmann::json result = outcome.json();
  EXPECT_EQ(numbersOf(result["target_pa"]), (std::vector<double>{1e5, 0, 5e4}));
  const std::vector<double> reached = numbersOf(result["pressure_pa"]);
  EXPECT_NEAR(reached[0], 1e5, 200);
  EXPECT_NEAR(reached[1], 0, 200);
  EXPECT_NEAR(reached[2], 5e4, 200);
  EXPECT_EQ(result["state"], "vented");
  EXPECT_TRUE(result["reason"].is_null());
  EXPECT_LT(fullest(device), kEmpty);
  EXPECT_EQ(device.setPoint().maxCoeff(), 0);
}

TEST(RegulatorSet, HardwareMovesOnlyWhenToldTo) {
  EmulatedDevice device(deviceConfig());
  expectCallerError(run(device.port(), {"set", "--pressure-kpa", "100,0,50"}),
                    "set moves the hardware modbus_tcp festo_vtem at 127.0.0.1:" +
                        std::to_string(device.port()) + "; add --yes once nobody is within");
  EXPECT_EQ(device.taken(), 0u);
}

TEST(RegulatorSet, VentsWhenItIsInterrupted) {
  for (const int number : {SIGINT, SIGTERM}) {
    EmulatedDevice device(deviceConfig());
    Process command(setsForLong(device));
    ASSERT_TRUE(eventually([&] { return fullest(device) > 9.5e4; })) << command.outputNow();
    ASSERT_TRUE(command.prints("enabled: muscle_1 ")) << command.outputNow();
    kill(command.id(), number);
    EXPECT_EQ(command.exitCode(), 1);
    EXPECT_LT(fullest(device), kEmpty);
    EXPECT_TRUE(has(command.outputNow(), "interrupted"));
    EXPECT_TRUE(has(command.outputNow(), "state  vented"));
  }
}

TEST(RegulatorVent, EmptiesAnArmThatNoProcessHolds) {
  EmulatedDevice device(deviceConfig());
  fill(device);
  const Outcome outcome = run(device.port(), {"vent", "--format", "json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(outcome.json()["vented"], true);
  for (const double each : numbersOf(outcome.json()["pressure_pa"])) EXPECT_LE(each, kEmpty);
  EXPECT_LT(fullest(device), kEmpty);
  const std::string text = run(device.port(), {"vent", "--set", "safety.vented_below_kpa=12"}).out;
  EXPECT_TRUE(has(text, "vented below  12 kPa"));
}

TEST(RegulatorVent, WhatCannotBeVentedIsNamed) {
  const Outcome nobody = run(freePort(), {"vent", "--format", "json"});
  EXPECT_EQ(nobody.exit_code, 1);
  EXPECT_EQ(nobody.json()["vented"], false);
  EXPECT_TRUE(has(nobody.err, "not vented: 127.0.0.1:"));
  EmulatedDevice device(deviceConfig());
  fill(device);
  device.setFault(DeviceFault::kStuckValue);
  const Outcome stuck = run(device.port(), {"vent", "--set", "safety.vent_time_s=0.3"});
  EXPECT_EQ(stuck.exit_code, 1);
  EXPECT_EQ(stuck.out, "");
  EXPECT_TRUE(has(stuck.err, "not vented: muscle_1 still has "));
  EXPECT_TRUE(has(stuck.err, "after 0.3 s; shut the supply"));
}

TEST(RegulatorGuard, VentsAfterTheEndOfTheMovingProcess) {
  EmulatedDevice device(deviceConfig());
  fill(device);
  Process guard(words(at(device.port(), {"guard"})));
  // It is ready once it ignores the signals that would end it.
  const auto ignores = [&guard] {
    const std::string status = contentOf("/proc/" + std::to_string(guard.id()) + "/status");
    const std::size_t found = status.find("SigIgn:");
    if (found == std::string::npos) return false;
    return (std::stoull(status.substr(found + 7), nullptr, 16) >> (SIGTERM - 1) & 1) == 1;
  };
  ASSERT_TRUE(eventually(ignores));
  for (const int number : {SIGINT, SIGTERM, SIGHUP}) guard.signal(number);
  EXPECT_EQ(guard.exitCode(0.3), -1);
  EXPECT_GT(fullest(device), 1.9e5);

  guard.endInput();  // as of a process that is killed
  ASSERT_TRUE(eventually([&] { return fullest(device) < kEmpty; }, 5.0));
  EXPECT_EQ(guard.exitCode(), 0);
  const std::string said = guard.outputNow();
  EXPECT_EQ(
      said.find(
          "guard: the process that moved the arm ended without venting it; modbus_tcp festo_vtem"),
      0u)
      << said;
  EXPECT_TRUE(has(said, " is vented, after "));
  EXPECT_EQ(std::count(said.begin(), said.end(), '\n'), 1);
}

}  // namespace
}  // namespace helix_arm::test
