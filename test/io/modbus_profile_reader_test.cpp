// Every rule of a Modbus profile's file, broken once; and what the shipped ones hold.

#include <gtest/gtest.h>

#include "io/scene/profile_file.hpp"
#include "profile_text.hpp"
#include "support/modbus_profiles.hpp"

namespace helix_arm::io {
namespace {

using regulator::ModbusProfile;
using test::replaced;
using ReadResult = test::ReadProfile<ModbusProfile>;

ReadResult readText(const std::string& text) {
  return test::readProfile(text, "modbus_tcp", readModbusProfile);
}

const char* const kAll = R"(modbus_tcp:
  unit_id: 7
  count_pa: 6.5
  atmosphere_kpa: 101.3
  highest_count: 4000
  outlets: 3
  outputs: {first: 100, stride: 5, pressure: 2}
  inputs: {first: 200, stride: 4, pressure: 1, registers: input}
  supply: 300
  app: {command: 1, regulate: 10, off: 11, acknowledge: 12, status: 0, status_mask: 255, ready: 21, running: 22, activation_time_s: 3}
  timeout_s: 0.25
  channels: 24
)";

TEST(ModbusProfileReader, EveryKeyIsRead) {
  const ReadResult result = readText(kAll);
  ASSERT_EQ(result.faults, std::vector<std::string>());
  const ModbusProfile& profile = *result.profile;
  EXPECT_EQ(profile.name, "mine");
  EXPECT_EQ(profile.unit_id, 7);
  EXPECT_EQ(profile.pascals, 6.5);
  EXPECT_EQ(profile.atmosphere, 101.3e3);
  EXPECT_EQ(profile.highest_count, 4000);
  EXPECT_EQ(profile.outlets, 3);
  EXPECT_EQ(profile.channels, 24);
  EXPECT_NEAR(profile.highestPressure(), 4000 * 6.5 - 101.3e3, 1e-9);
  EXPECT_EQ(profile.output_base, 100);
  EXPECT_EQ(profile.output_stride, 5);
  EXPECT_EQ(profile.output_pressure, 2);
  EXPECT_EQ(profile.input_base, 200);
  EXPECT_EQ(profile.input_stride, 4);
  EXPECT_EQ(profile.input_pressure, 1);
  EXPECT_TRUE(profile.input_registers);
  EXPECT_EQ(profile.supply, 300);
  ASSERT_TRUE(profile.app);
  EXPECT_EQ(profile.app->command, 1);
  EXPECT_EQ(profile.app->regulate, 10);
  EXPECT_EQ(profile.app->off, 11);
  EXPECT_EQ(profile.app->acknowledge, 12);
  EXPECT_EQ(profile.app->status, 0);
  EXPECT_EQ(profile.app->status_mask, 255);
  EXPECT_EQ(profile.app->ready, 21);
  EXPECT_EQ(profile.app->running, 22);
  EXPECT_EQ(profile.app->activation_time, 3);
  EXPECT_EQ(profile.timeout, 0.25);
}

TEST(ModbusProfileReader, OptionalKeysHaveDefaults) {
  const ReadResult result = readText(
      "modbus_tcp:\n  count_pa: 100\n  highest_count: 1000\n"
      "  outputs: {first: 0, stride: 1, pressure: 0}\n"
      "  inputs: {first: 0, stride: 1, pressure: 0, registers: holding}\n");
  ASSERT_EQ(result.faults, std::vector<std::string>());
  EXPECT_EQ(result.profile->unit_id, 255);
  EXPECT_EQ(result.profile->atmosphere, 0);
  EXPECT_EQ(result.profile->outlets, 1);
  EXPECT_FALSE(result.profile->input_registers);
  EXPECT_FALSE(result.profile->channels);
  EXPECT_FALSE(result.profile->supply);
  EXPECT_FALSE(result.profile->app);
  EXPECT_EQ(result.profile->timeout, 0.1);
}

TEST(ModbusProfileReader, EachBrokenRuleIsAFaultWithItsLine) {
  const auto faults = [](const std::string& text) {
    const ReadResult result = readText(text);
    EXPECT_EQ(result.profile.has_value(), result.faults.empty());
    return result.faults;
  };
  test::expectFaults("modbus_profile", kAll, faults, "f");
}

TEST(ModbusProfileReader, UnknownAndMissingKeysAreNamedTogether) {
  EXPECT_EQ(readText(replaced(kAll, "count_pa: 6.5", "count_kpa: 6.5")).faults,
            (std::vector<std::string>{
                "f:3 modbus_tcp.count_kpa is not a known key; did you mean count_pa?",
                "f:1 modbus_tcp.count_pa is missing; expected a finite value > 0"}));
  EXPECT_EQ(readText("modbus_tcp:\n  unit_id: 1\n").faults,
            (std::vector<std::string>{
                "f:1 modbus_tcp.count_pa is missing; expected a finite value > 0",
                "f:1 modbus_tcp.highest_count is missing; expected a whole number from 1 to 32767",
                "f:1 modbus_tcp.outputs is missing; expected a map of first, stride and pressure",
                "f:1 modbus_tcp.inputs is missing; expected a map of first, stride, pressure and "
                "registers"}));
}

// Except for the longer timeouts of tests.
void expectSame(const ModbusProfile& read, const ModbusProfile& expected) {
  EXPECT_EQ(read.unit_id, expected.unit_id);
  EXPECT_EQ(read.pascals, expected.pascals);
  EXPECT_EQ(read.atmosphere, expected.atmosphere);
  EXPECT_EQ(read.highest_count, expected.highest_count);
  EXPECT_EQ(read.outlets, expected.outlets);
  EXPECT_EQ(read.output_base, expected.output_base);
  EXPECT_EQ(read.output_stride, expected.output_stride);
  EXPECT_EQ(read.output_pressure, expected.output_pressure);
  EXPECT_EQ(read.input_base, expected.input_base);
  EXPECT_EQ(read.input_stride, expected.input_stride);
  EXPECT_EQ(read.input_pressure, expected.input_pressure);
  EXPECT_EQ(read.input_registers, expected.input_registers);
  EXPECT_EQ(read.supply, expected.supply);
  EXPECT_EQ(read.timeout, 0.1);
  ASSERT_EQ(read.app.has_value(), expected.app.has_value());
  if (!read.app) return;
  EXPECT_EQ(read.app->command, expected.app->command);
  EXPECT_EQ(read.app->regulate, expected.app->regulate);
  EXPECT_EQ(read.app->off, expected.app->off);
  EXPECT_EQ(read.app->acknowledge, expected.app->acknowledge);
  EXPECT_EQ(read.app->status, expected.app->status);
  EXPECT_EQ(read.app->status_mask, expected.app->status_mask);
  EXPECT_EQ(read.app->ready, expected.app->ready);
  EXPECT_EQ(read.app->running, expected.app->running);
}

// Those that the drivers' tests use are those that are shipped.
TEST(ModbusProfileReader, TheShippedOnesHold) {
  const ReadResult vtem = readText(test::shippedProfile("festo_vtem"));
  ASSERT_EQ(vtem.faults, std::vector<std::string>());
  expectSame(*vtem.profile, test::vtemProfile());
  EXPECT_EQ(vtem.profile->app->activation_time, 2);
  const ReadResult mpa = readText(test::shippedProfile("festo_mpa"));
  ASSERT_EQ(mpa.faults, std::vector<std::string>());
  expectSame(*mpa.profile, test::mpaProfile());
}

}  // namespace
}  // namespace helix_arm::io
