#pragma once

#include <limits>
#include <ostream>
#include <variant>

#include "io/scene/regulator_profile.hpp"

namespace helix_arm::regulator {

/// For messages of tests.
inline void PrintTo(const SerialProfile& profile, std::ostream* out) { *out << profile.name; }

}  // namespace helix_arm::regulator

namespace helix_arm::test {

/// Such that a busy machine is not taken for a silent device [s].
inline constexpr double kSerialTimeout = 0.2;

/// A shipped profile without the device's watchdog, which a busy machine would meet.
inline regulator::SerialProfile shippedSerial(const std::string& name) {
  auto profile = std::get<regulator::SerialProfile>(io::loadRegulatorProfile(name));
  profile.timeout = kSerialTimeout;
  profile.watchdog = std::numeric_limits<double>::infinity();
  return profile;
}

inline regulator::SerialProfile alicatProfile() { return shippedSerial("alicat"); }
inline regulator::SerialProfile genericProfile() { return shippedSerial("generic"); }
inline regulator::SerialProfile ctrlPProfile() {
  regulator::SerialProfile profile = shippedSerial("ctrl_p");
  profile.timeout = 2.5 * kSerialTimeout;  // a busy machine keeps back what it says by itself
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
