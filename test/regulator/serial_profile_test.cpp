#include "helix_arm/regulator/serial_profile.hpp"

#include <functional>

#include <gtest/gtest.h>

#include "support/refusal.hpp"
#include "support/serial_profiles.hpp"

namespace helix_arm::regulator {
namespace {

using test::refusal;

std::string faultOf(SerialProfile profile, const std::function<void(SerialProfile&)>& change) {
  change(profile);
  return refusal([&] { profile.validate(); });
}

TEST(SerialProfile, GoodOnesAreAccepted) {
  for (const SerialProfile& profile : {test::alicatProfile(), test::ctrlPProfile(),
                                       test::genericProfile(), test::togetherProfile()}) {
    EXPECT_EQ(refusal([&] { profile.validate(); }), "accepted") << profile.name;
  }
}

TEST(SerialProfile, UnitsAreConvertedBothWays) {
  SerialProfile profile;
  profile.pascals = 6894.757293168;
  EXPECT_NEAR(profile.toPascals(60), 413685.4, 0.1);  // 60 psi
  EXPECT_NEAR(profile.fromPascals(413685.43759), 60, 1e-9);
  profile.pascals = 100;
  profile.atmosphere = 101325;  // millibar from vacuum
  EXPECT_NEAR(profile.toPascals(1013.25), 0, 1e-9);
  EXPECT_NEAR(profile.fromPascals(1e5), 2013.25, 1e-9);
}

TEST(SerialProfile, EachRuleIsNamed) {
  const struct {
    std::function<void(SerialProfile&)> change;
    const char* fault;
  } kCases[] = {
      {[](SerialProfile& p) { p.baud = 19201; },
       "baud is 19201; expected a standard rate from 1200 to 2000000"},
      {[](SerialProfile& p) { p.terminator = ";"; },
       "terminator is \";\"; expected a carriage return, a line feed or both"},
      {[](SerialProfile& p) { p.pascals = 0; },
       "the size of the unit [Pa] is 0; expected 1e-3 to 1e8"},
      {[](SerialProfile& p) { p.atmosphere = -1; }, "the atmosphere [Pa] is -1; expected 0 to 2e5"},
      {[](SerialProfile& p) { p.decimals = 7; }, "decimals is 7; expected 0 to 6"},
      {[](SerialProfile& p) { p.separator = "-"; },
       "a separator is \"-\"; expected 1 to 4 characters that no number contains"},
      {[](SerialProfile& p) { p.reply_separator = ""; },
       "a separator is \"\"; expected 1 to 4 characters that no number contains"},
      {[](SerialProfile& p) { p.unit_word = "k Pa"; },
       "unit_word is \"k Pa\"; expected a word without spaces and braces"},
      {[](SerialProfile& p) { p.timeout = 0; }, "timeout [s] is 0; expected 0.001 to 10"},
      {[](SerialProfile& p) { p.watchdog = 0; },
       "watchdog [s] is 0; expected 0.1 or more, and at least twice the timeout"},
      {[](SerialProfile& p) { p.watchdog = 1.9 * p.timeout; },
       "watchdog [s] is 0.38; expected 0.1 or more, and at least twice the timeout"},
      {[](SerialProfile& p) { p.write = ""; }, "write is missing"},
      {[](SerialProfile& p) { p.reply = ""; }, "reply is missing"},
      {[](SerialProfile& p) { p.vent.clear(); },
       "vent is missing; a fault must be able to release the pressure"},
      {[](SerialProfile& p) { p.write = "p{address}"; }, "write has no {pressure}"},
      {[](SerialProfile& p) { p.reply = "p{address} {unit}"; }, "reply has no {pressure}"},
      {[](SerialProfile& p) { p.write = "p{address}={pressure} {supply}"; },
       "write has {supply}, which a line to the device cannot have"},
      {[](SerialProfile& p) { p.vent = {"p{address}={pressure}"}; },
       "vent has {pressure}, which a line to the device cannot have"},
      {[](SerialProfile& p) { p.vent = {"vent"}; }, "vent has no {address}, but write has"},
      {[](SerialProfile& p) { p.start = {"hello {address}"}; },
       "start has {address}, which a line to the device cannot have"},
      {[](SerialProfile& p) { p.write = "p{addres}={pressure}"; },
       "write \"p{addres}={pressure}\" has {addres}; expected {address}, {pressure}, {pressures}, "
       "{set_point}, {supply}, {unit}, {*}, {words} or {...}"},
      {[](SerialProfile& p) { p.read = ""; },
       "read is missing, so one_by_one must be false: unsolicited readings come in one line for "
       "all channels"},
      {[](SerialProfile& p) { p.skip = {"#{...}"}; },
       "supply_line and skip apply to unsolicited lines, but read is given"},
  };
  for (const auto& entry : kCases) {
    EXPECT_EQ(faultOf(test::genericProfile(), entry.change),
              std::string("serial profile: ") + entry.fault);
  }
  EXPECT_EQ(faultOf(test::ctrlPProfile(), [](SerialProfile& p) { p.close = {"valve;0"}; }),
            "serial profile: close is given, but one_by_one is false: one channel alone cannot be "
            "closed");
  EXPECT_EQ(faultOf(test::ctrlPProfile(), [](SerialProfile& p) { p.write_reply = "ok"; }),
            "serial profile: read is missing, so write_reply and vent_reply must be missing: "
            "unsolicited lines answer nothing");
  EXPECT_EQ(faultOf(test::ctrlPProfile(), [](SerialProfile& p) { p.supply_line = "2 {*}"; }),
            "serial profile: supply_line has no {supply}");
  EXPECT_EQ(faultOf(test::togetherProfile(),
                    [](SerialProfile& p) { p.write = "SET {address} {pressures}"; }),
            "serial profile: vent has no {address}, but write has");
}

}  // namespace
}  // namespace helix_arm::regulator
