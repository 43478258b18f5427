// Every rule of a profile's file, broken once; and what the shipped ones hold.

#include <cmath>
#include <tuple>

#include <gtest/gtest.h>

#include "io/scene/scene_readers.hpp"
#include "scene_faults.hpp"
#include "support/modbus_profiles.hpp"
#include "support/serial_profiles.hpp"

namespace helix_arm::io {
namespace {

using regulator::ModbusApp;
using regulator::ModbusProfile;
using regulator::SerialProfile;
using test::Faults;
using test::replaced;

// What a text in the file "f" gives; the profile is called "mine".
struct ReadResult {
  explicit ReadResult(const std::string& text) {
    FaultList list("f");
    const std::optional<Value> document = parseDocument(text, {}, list);
    if (document) profile = readProfile(*document, nullptr, "mine", list);
    faults = list.faults();
    EXPECT_EQ(profile.has_value(), faults.empty());
  }
  std::optional<regulator::Profile> profile;
  Faults faults;
};

template <class Profile>
Profile profileOf(const std::string& text) {
  return std::get<Profile>(ReadResult(text).profile.value());
}

void expectFaultsOf(const std::string& kind, const std::string& text) {
  const auto faults = [](const std::string& broken) { return ReadResult(broken).faults; };
  test::expectFaults(kind, text, faults, "f");
}

// Except for times, which are longer in tests of drivers, and for the size of a device.
auto membersOf(const SerialProfile& p) {
  return std::tie(p.baud, p.terminator, p.pascals, p.atmosphere, p.unit_word, p.decimals,
                  p.separator, p.reply_separator, p.one_by_one, p.start, p.write, p.write_reply,
                  p.read, p.reply, p.supply_line, p.skip, p.vent, p.close, p.resume, p.vent_reply,
                  p.checksum);
}
auto membersOf(const ModbusProfile& p) {
  return std::tie(p.unit_id, p.pascals, p.atmosphere, p.highest_count, p.outlets, p.output_base,
                  p.output_stride, p.output_pressure, p.input_base, p.input_stride,
                  p.input_pressure, p.input_registers, p.supply);
}
auto membersOf(const ModbusApp& app) {
  return std::tie(app.command, app.regulate, app.off, app.acknowledge, app.status, app.status_mask,
                  app.ready, app.running);
}

const char* const kSerial = R"(ascii_serial:
  baud: 9600
  terminator: crlf
  unit: mbar
  scale: 0.5
  atmosphere_kpa: 101.325
  unit_word: mbar
  decimals: 3
  separator: ","
  reply_separator: " "
  one_by_one: false
  start: [hello, "echo off"]
  write: "set {pressures}"
  write_reply: ok
  read: get
  reply: "{pressures} {unit}"
  vent: [stop, vent]
  resume: go
  vent_reply: done
  timeout_s: 0.25
  watchdog_s: 1.5
  highest_kpa: 250
  channels: 12
  checksum: crc16
)";

const char* const kModbus = R"(modbus_tcp:
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

TEST(SerialProfileReader, EveryKeyIsRead) {
  const auto profile = profileOf<SerialProfile>(kSerial);
  EXPECT_EQ(profile.name, "mine");
  EXPECT_EQ(membersOf(profile),
            std::make_tuple(9600, "\r\n", 50.0, 101325.0, "mbar", 3, ",", " ", false,
                            Faults{"hello", "echo off"}, "set {pressures}", "ok", "get",
                            "{pressures} {unit}", "", Faults(), Faults{"stop", "vent"}, Faults(),
                            Faults{"go"}, "done", true));
  EXPECT_EQ(profile.timeout, 0.25);
  EXPECT_EQ(profile.watchdog, 1.5);
  EXPECT_EQ(profile.highestPressure(), 250e3);
  EXPECT_EQ(profile.channels, 12);
}

TEST(SerialProfileReader, WithoutItsRangeADeviceHasNone) {
  const auto profile =
      profileOf<SerialProfile>(replaced(kSerial, "  highest_kpa: 250\n  channels: 12\n", ""));
  EXPECT_TRUE(std::isinf(profile.highestPressure()));
  EXPECT_FALSE(profile.channels);
}

TEST(SerialProfileReader, TheShippedProfilesAreThoseOfTheDriverTests) {
  for (const SerialProfile& expected :
       {test::alicatProfile(), test::ctrlPProfile(), test::genericProfile()}) {
    const auto profile = std::get<SerialProfile>(loadRegulatorProfile(expected.name));
    EXPECT_EQ(profile.name, expected.name);
    EXPECT_EQ(membersOf(profile), membersOf(expected)) << expected.name;
    // On a busy machine a line may be late: the tests' own do without.
    EXPECT_EQ(profile.watchdog, expected.name == "generic" ? 0.5 : expected.watchdog);
    EXPECT_TRUE(std::isinf(expected.watchdog));
  }
}

TEST(SerialProfileReader, BreakingARuleIsReported) { expectFaultsOf("serial_profile", kSerial); }

TEST(ModbusProfileReader, EveryKeyIsRead) {
  const auto profile = profileOf<ModbusProfile>(kModbus);
  EXPECT_EQ(profile.name, "mine");
  EXPECT_EQ(membersOf(profile),
            std::make_tuple(7, 6.5, 101.3e3, 4000, 3, 100, 5, 2, 200, 4, 1, true, 300));
  EXPECT_EQ(profile.channels, 24);
  EXPECT_NEAR(profile.highestPressure(), 4000 * 6.5 - 101.3e3, 1e-9);
  EXPECT_EQ(membersOf(profile.app.value()), std::make_tuple(1, 10, 11, 12, 0, 255, 21, 22));
  EXPECT_EQ(profile.app->activation_time, 3);
  EXPECT_EQ(profile.timeout, 0.25);
}

TEST(ModbusProfileReader, OptionalKeysHaveDefaults) {
  const auto profile = profileOf<ModbusProfile>(
      "modbus_tcp:\n  count_pa: 100\n  highest_count: 1000\n"
      "  outputs: {first: 0, stride: 1, pressure: 0}\n"
      "  inputs: {first: 0, stride: 1, pressure: 0, registers: holding}\n");
  EXPECT_EQ(membersOf(profile),
            std::make_tuple(255, 100, 0, 1000, 1, 0, 1, 0, 0, 1, 0, false, std::nullopt));
  EXPECT_FALSE(profile.app);
  EXPECT_FALSE(profile.channels);
  EXPECT_EQ(profile.timeout, 0.1);
}

TEST(ModbusProfileReader, EachBrokenRuleIsAFaultWithItsLine) {
  expectFaultsOf("modbus_profile", kModbus);
}

TEST(ModbusProfileReader, UnknownAndMissingKeysAreNamedTogether) {
  EXPECT_EQ(ReadResult(replaced(kModbus, "count_pa: 6.5", "count_kpa: 6.5")).faults,
            (Faults{"f:3 modbus_tcp.count_kpa is not a known key; did you mean count_pa?",
                    "f:1 modbus_tcp.count_pa is missing; expected a finite value > 0"}));
  EXPECT_EQ(
      ReadResult("modbus_tcp:\n  unit_id: 1\n").faults,
      (Faults{"f:1 modbus_tcp.count_pa is missing; expected a finite value > 0",
              "f:1 modbus_tcp.highest_count is missing; expected a whole number from 1 to 32767",
              "f:1 modbus_tcp.outputs is missing; expected a map of first, stride and pressure",
              "f:1 modbus_tcp.inputs is missing; expected a map of first, stride, pressure and "
              "registers"}));
}

TEST(ModbusProfileReader, TheShippedOnesAreThoseOfTheDriverTests) {
  for (const ModbusProfile& expected : {test::vtemProfile(), test::mpaProfile()}) {
    const auto profile = std::get<ModbusProfile>(loadRegulatorProfile(expected.name));
    EXPECT_EQ(profile.name, expected.name);
    EXPECT_EQ(membersOf(profile), membersOf(expected)) << expected.name;
    EXPECT_EQ(profile.timeout, 0.1);
    ASSERT_EQ(profile.app.has_value(), expected.app.has_value());
    if (!profile.app) continue;
    EXPECT_EQ(membersOf(*profile.app), membersOf(*expected.app));
    EXPECT_EQ(profile.app->activation_time, 2);
  }
}

}  // namespace
}  // namespace helix_arm::io
