#pragma once

#include <ostream>

#include "helix_arm/regulator/config.hpp"

namespace helix_arm::regulator {

/// For messages of tests.
inline void PrintTo(const SerialProfile& profile, std::ostream* out) { *out << profile.name; }

}  // namespace helix_arm::regulator

namespace helix_arm::test {

/// Such that a busy machine is not taken for a silent device [s].
inline constexpr double kSerialTimeout = 0.2;

/// As config/regulators/alicat.yaml, except for the timeout; the same holds for the others.
inline regulator::SerialProfile alicatProfile() {
  regulator::SerialProfile profile;
  profile.name = "alicat";
  profile.baud = 19200;
  profile.terminator = "\r";
  profile.pascals = 6894.757293168;
  profile.unit_word = "PSIG";
  profile.unit_query = "{address}LS";
  profile.unit_reply = "{address} {*} {*} {*} {unit}";
  profile.write = "{address}S{pressure}";
  profile.write_reply = "{address} {pressure} {set_point}{words}";
  profile.read = "{address}";
  profile.reply = profile.write_reply;
  profile.vent = {"{address}C", "{address}S0.00"};
  profile.close = {"{address}HC"};
  profile.resume = {"{address}C"};
  profile.vent_reply = profile.write_reply;
  profile.timeout = kSerialTimeout;
  return profile;
}

/// As config/regulators/ctrl_p.yaml.
inline regulator::SerialProfile ctrlPProfile() {
  regulator::SerialProfile profile;
  profile.name = "ctrl_p";
  profile.one_by_one = false;
  profile.reply_separator = "\t";
  profile.start = {"echo;0", "units;1;1", "time;20", "chan;1", "on"};
  profile.write = "set;0;{pressures}";
  profile.reply = "{*}\t1\t{pressures}";
  profile.supply_line = "{*}\t2\t{supply}";
  profile.skip = {"{*}\t0\t{...}", "_{...}"};
  profile.vent = {"valve;-1", "mode;0"};
  profile.resume = {"mode;1"};
  profile.timeout = 2.5 * kSerialTimeout;  // a busy machine keeps back what it says by itself
  return profile;
}

/// As config/regulators/generic.yaml.
inline regulator::SerialProfile genericProfile() {
  regulator::SerialProfile profile;
  profile.name = "generic";
  profile.unit_word = "kPa";
  profile.write = "p{address}={pressure}";
  profile.write_reply = "p{address}={pressure} {unit}";
  profile.read = "p{address}?";
  profile.reply = profile.write_reply;
  profile.vent = {"p{address}=vent"};
  profile.close = {"p{address}=close"};
  profile.vent_reply = profile.write_reply;
  profile.timeout = kSerialTimeout;
  return profile;
}

/// The same lines, each with its checksum.
inline regulator::SerialProfile withChecksums(regulator::SerialProfile profile) {
  profile.name += "_checksum";
  profile.checksum = true;
  return profile;
}

/// One line for all channels, on being asked, with the supply in it, counted from vacuum.
inline regulator::SerialProfile togetherProfile() {
  regulator::SerialProfile profile;
  profile.name = "together";
  profile.terminator = "\r\n";
  profile.pascals = 100;
  profile.atmosphere = 101325;
  profile.decimals = 0;
  profile.separator = profile.reply_separator = ",";
  profile.one_by_one = false;
  profile.write = "SET {pressures}";
  profile.write_reply = "OK";
  profile.read = "GET";
  profile.reply = "P {pressures} S {supply}";
  profile.vent = {"VENT"};
  profile.vent_reply = "OK";
  profile.timeout = kSerialTimeout;
  return profile;
}

}  // namespace helix_arm::test
