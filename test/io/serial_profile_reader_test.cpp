// Every rule of a serial profile's file, broken once; and what the shipped ones hold.

#include <cmath>

#include <gtest/gtest.h>

#include "io/scene/profile_file.hpp"
#include "profile_text.hpp"
#include "support/serial_profiles.hpp"

namespace helix_arm::io {
namespace {

using regulator::SerialProfile;
using test::replaced;
using ReadResult = test::ReadProfile<SerialProfile>;

ReadResult readText(const std::string& text) {
  return test::readProfile(text, "ascii_serial", readSerialProfile);
}

const char* const kAll = R"(ascii_serial:
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

TEST(SerialProfileReader, EveryKeyIsRead) {
  const ReadResult result = readText(kAll);
  ASSERT_TRUE(result.profile) << result.faults.at(0);
  const SerialProfile& profile = *result.profile;
  EXPECT_EQ(profile.name, "mine");
  EXPECT_EQ(profile.baud, 9600);
  EXPECT_EQ(profile.terminator, "\r\n");
  EXPECT_EQ(profile.pascals, 50.0);
  EXPECT_EQ(profile.atmosphere, 101325.0);
  EXPECT_EQ(profile.unit_word, "mbar");
  EXPECT_EQ(profile.decimals, 3);
  EXPECT_EQ(profile.separator, ",");
  EXPECT_EQ(profile.reply_separator, " ");
  EXPECT_FALSE(profile.one_by_one);
  EXPECT_EQ(profile.start, (std::vector<std::string>{"hello", "echo off"}));
  EXPECT_EQ(profile.write, "set {pressures}");
  EXPECT_EQ(profile.write_reply, "ok");
  EXPECT_EQ(profile.read, "get");
  EXPECT_EQ(profile.reply, "{pressures} {unit}");
  EXPECT_EQ(profile.vent, (std::vector<std::string>{"stop", "vent"}));
  EXPECT_EQ(profile.resume, std::vector<std::string>{"go"});
  EXPECT_EQ(profile.vent_reply, "done");
  EXPECT_EQ(profile.timeout, 0.25);
  EXPECT_EQ(profile.watchdog, 1.5);
  EXPECT_EQ(profile.highestPressure(), 250e3);
  EXPECT_EQ(profile.channels, 12);
  EXPECT_TRUE(profile.checksum);
}

TEST(SerialProfileReader, WithoutItsRangeADeviceHasNone) {
  const ReadResult result = readText(replaced(kAll, "  highest_kpa: 250\n  channels: 12\n", ""));
  ASSERT_TRUE(result.profile) << result.faults.at(0);
  EXPECT_TRUE(std::isinf(result.profile->highestPressure()));
  EXPECT_FALSE(result.profile->channels);
}

TEST(SerialProfileReader, TheShippedProfilesAreThoseOfTheDriverTests) {
  for (SerialProfile expected :
       {test::alicatProfile(), test::ctrlPProfile(), test::genericProfile()}) {
    SCOPED_TRACE(expected.name);
    const ReadResult result = readText(test::shippedProfile(expected.name));
    ASSERT_TRUE(result.profile) << result.faults.at(0);
    const SerialProfile& profile = *result.profile;
    EXPECT_EQ(profile.baud, expected.baud);
    EXPECT_EQ(profile.terminator, expected.terminator);
    EXPECT_EQ(profile.pascals, expected.pascals);
    EXPECT_EQ(profile.atmosphere, expected.atmosphere);
    EXPECT_EQ(profile.unit_word, expected.unit_word);
    EXPECT_EQ(profile.decimals, expected.decimals);
    EXPECT_EQ(profile.separator, expected.separator);
    EXPECT_EQ(profile.reply_separator, expected.reply_separator);
    EXPECT_EQ(profile.one_by_one, expected.one_by_one);
    EXPECT_EQ(profile.checksum, expected.checksum);
    EXPECT_EQ(profile.start, expected.start);
    EXPECT_EQ(profile.write, expected.write);
    EXPECT_EQ(profile.write_reply, expected.write_reply);
    EXPECT_EQ(profile.read, expected.read);
    EXPECT_EQ(profile.reply, expected.reply);
    EXPECT_EQ(profile.supply_line, expected.supply_line);
    EXPECT_EQ(profile.skip, expected.skip);
    EXPECT_EQ(profile.vent, expected.vent);
    EXPECT_EQ(profile.close, expected.close);
    EXPECT_EQ(profile.resume, expected.resume);
    EXPECT_EQ(profile.vent_reply, expected.vent_reply);
    // On a busy machine a line may be late: the tests' own do without.
    const bool watches = expected.name == "generic";
    EXPECT_EQ(profile.watchdog, watches ? 0.5 : expected.watchdog);
    EXPECT_TRUE(std::isinf(expected.watchdog));
  }
}

TEST(SerialProfileReader, BreakingARuleIsReported) {
  const auto faults = [](const std::string& text) { return readText(text).faults; };
  test::expectFaults("serial_profile", kAll, faults, "f");
}

}  // namespace
}  // namespace helix_arm::io
