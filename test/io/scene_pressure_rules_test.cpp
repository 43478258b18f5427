// What a scene says of the pressure path: regulators, their profiles, and safety.

#include <cmath>
#include <fstream>

#include <gtest/gtest.h>

#include "scene_faults.hpp"
#include "support/refusal.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::io {
namespace {

using test::BrokenRule;
using test::BrokenValue;
using test::Faults;
using test::faultsOf;
using test::kPlanarScene;
using test::kSpatialScene;
using test::replaced;
using test::sceneOf;
using test::TemporaryFolder;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// A regulator on a serial line at line 11, one that speaks Modbus, and rules of safety at line 12.
const std::string kSerialScene =
    kPlanarScene +
    "regulator: {ascii_serial: {profile: generic, device: /dev/ttyUSB0, "
    "addresses: [a, b]}}\n"
    "safety: {fault_action: {muscle_2: close}}\n";
const std::string kModbusScene = kPlanarScene +
                                 "regulator: {modbus_tcp: {profile: festo_vtem, host: terminal, "
                                 "port: 1502, slots: [3, 1]}}\n";

void write(const std::string& path, const std::string& text) { std::ofstream(path) << text; }

std::string faultsOfFile(const std::string& path) {
  return test::refusal<DocumentError>([&path] { loadScene(path); });
}

const BrokenValue kSafetyValues[] = {
    {"safety.", "target_timeout_s: 2", "-1", "a finite value >= 0"},
    {"safety.", "target_timeout_s: 2", "1000000", "0 to 3600 s"},
    {"safety.", "reading_timeout_s: 0.4", "0", "a finite value > 0"},
    {"safety.", "slew_kpa_s: 200", "0", "a finite value > 0"},
    {"safety.", "slew_kpa_s: 200", ".inf", "a finite value > 0"},
    {"safety.", "trip_margin_kpa: 20", "-1", "a finite value >= 0"},
    {"safety.", "trip_margin_kpa: 20, ", "20, trip_margin_kpa: 20, ",
     " is given twice; expected it once"},
    {"safety.", "spike_time_s: 0.2", "-0.1", "a finite value >= 0"},
    {"safety.", "min_supply_kpa: 300", "0", "a finite value > 0"},
    {"safety.follow.", "tolerance_kpa: 50", "0", "a finite value > 0"},
    {"safety.follow.", "time_s: 1.5", "0", "a finite value > 0"},
    {"safety.follow.", "time_constant_s: 0.3", "fast", "a finite value > 0"},
    {"safety.follow.", "tolerance_kpa: 50", "tolerance_kp: 50",
     " is not a known key; did you mean tolerance_kpa?"},
    {"safety.", "leak_drop_kpa: 15", "0", "a finite value > 0"},
    {"safety.", "fault_action: hold", "stop", "vent, hold or close"},
    {"safety.", "fault_action: hold", "[hold]", " is a list; expected vent, hold or close"},
    {"safety.", "fault_action: hold", "{muscle_9: hold}",
     ".muscle_9 is not a known key; did you mean muscle_1?"},
    {"safety.", "fault_action: hold", "{left: stay}",
     ".left is stay; expected vent, hold or close"},
    {"safety.", "hold_time_s: 5", "-1", "a finite value >= 0"},
    {"safety.", "vented_below_kpa: 12", "0", "a finite value > 0"},
    {"safety.", "vented_below_kpa: 12", "110",
     "less than 110, where muscle_5 is beyond its limits by safety.trip_margin_kpa"},
    {"safety.", "vent_time_s: 4", "0", "a finite value > 0"},
    {"safety.", "vent_time_s: 4", "vent_tme_s: 4",
     " is not a known key; did you mean vent_time_s?"},
};

const BrokenRule kSafetyRules[] = {
    {"time_constant_s: 0.3",
     "time_constant_s: 0.3, fall_time_constant_s: 0",
     {":34 safety.follow.fall_time_constant_s is 0; expected a finite value > 0"}},
    {"  simulated: {",
     "  simulated: {}\n  ascii_serial: {",
     {":32 regulator has simulated and ascii_serial; expected exactly one of simulated, "
      "ascii_serial or modbus_tcp"}},
    {"  simulated: {",
     "  simulatd: {",
     {":33 regulator.simulatd is not a known key; did you mean simulated?",
      ":32 regulator has none; expected exactly one of simulated, ascii_serial or modbus_tcp"}},
};

const BrokenValue kSerialValues[] = {
    {"regulator.ascii_serial.", "profile: generic", "generik",
     "alicat, ctrl_p, festo_mpa, festo_vtem or generic, or a path (with a / or ending in .yaml) "
     "from the scene's folder"},
    {"regulator.ascii_serial.", "device: /dev/ttyUSB0", "''",
     " is \"\"; expected a serial port like /dev/ttyUSB0"},
    {"regulator.ascii_serial.", "addresses: [a, b]", "[a, b, c]",
     " has 3 entries; expected 2 entries, one per actuator"},
    {"regulator.ascii_serial.", "addresses: [a, b]", "a", "a list of words, one per actuator"},
    {"regulator.ascii_serial.", "addresses: [a, b]", "[a, a]",
     "[1] is a; expected one that no other actuator has"},
    {"regulator.ascii_serial.", "addresses: [a, b]", "[a, b c]",
     "[1] is b c; expected a word without spaces"},
    {"safety.fault_action.", "muscle_2: close", "muscle_3: close",
     " is not a known key; did you mean muscle_1?"},
    {"safety.", "fault_action: {muscle_2: close}", "target_timeout_s: 0",
     "a finite value > 0: only a simulated regulator may wait for targets without limit"},
};

const BrokenRule kSerialRules[] = {
    {"profile: generic, ",
     "",
     {":11 regulator.ascii_serial.profile is missing; expected alicat, ctrl_p, festo_mpa, "
      "festo_vtem or generic, or a path (with a / or ending in .yaml) from the scene's folder"}},
    {"device: /dev/ttyUSB0, ",
     "",
     {":11 regulator.ascii_serial.device is missing; expected a serial port like /dev/ttyUSB0"}},
    {", addresses: [a, b]",
     "",
     {":11 regulator.ascii_serial.addresses is missing; profile generic addresses each channel: "
      "expected 2 entries, one per actuator"}},
    {"profile: generic",
     "profile: ctrl_p",
     {":11 regulator.ascii_serial.addresses is not used: the lines of profile ctrl_p have no "
      "{address}; expected none"}},
};

const BrokenValue kModbusValues[] = {
    {"regulator.modbus_tcp.", "port: 1502", "0", "a whole number from 1 to 65535"},
    {"regulator.modbus_tcp.", "slots: [3, 1]", "[3]",
     " has 1 entries; expected a list of 2 numbers, each a finite value >= 0"},
    {"regulator.modbus_tcp.", "slots: [3, 1]", "[3, 3]",
     " is a list; expected distinct whole numbers"},
    {"regulator.modbus_tcp.", "slots: [3, 1]", "[3, 0.5]",
     " is a list; expected distinct whole numbers"},
    {"regulator.modbus_tcp.", "slots: [3, 1]", "[3, -1]",
     "[1] is -1; expected a finite value >= 0"},
};

const BrokenRule kModbusRules[] = {
    {"host: terminal, ",
     "",
     {":11 regulator.modbus_tcp.host is missing; expected a name or address"}},
    {"pressure_kpa: [0, 400]",
     "pressure_kpa: [-50, 400]",
     {":11 regulator.modbus_tcp.profile is festo_vtem, which accepts 0 to 700 kPa; expected limits "
      "within that, not muscle_1's of -50 to 400 kPa",
      ":11 regulator.modbus_tcp.profile is festo_vtem, which accepts 0 to 700 kPa; expected limits "
      "within that, not muscle_2's of -50 to 400 kPa"}},
};

TEST(PressureRules, BreakingOneIsReported) {
  test::expectFaults(kSpatialScene, kSafetyValues);
  test::expectFaults(kSpatialScene, kSafetyRules);
  test::expectFaults(kSerialScene, kSerialValues);
  test::expectFaults(kSerialScene, kSerialRules);
  test::expectFaults(kModbusScene, kModbusValues);
  test::expectFaults(kModbusScene, kModbusRules);
}

TEST(PressureScene, SafetyIsInSi) {
  const SafetyConfig safety = sceneOf(kSpatialScene).safety;
  EXPECT_EQ(safety.commander_timeout, 0.8);
  EXPECT_EQ(safety.rules.target_timeout, 2);
  EXPECT_EQ(safety.rules.reading_timeout, 0.4);
  EXPECT_EQ(safety.rules.trip_margin, 2e4);
  EXPECT_EQ(safety.rules.spike_time, 0.2);
  EXPECT_EQ(safety.rules.min_supply, 3e5);
  EXPECT_EQ(safety.rules.follow_tolerance, 5e4);
  EXPECT_EQ(safety.rules.follow_time, 1.5);
  EXPECT_EQ(safety.rules.time_constant, 0.3);
  EXPECT_EQ(safety.rules.leak_drop, 1.5e4);
  EXPECT_EQ(safety.rules.hold_time, 5);
  EXPECT_EQ(safety.rules.vented_below, 1.2e4);
  EXPECT_EQ(safety.rules.vent_time, 4);
}

TEST(PressureScene, ChannelsAreTheActuatorsInTheirOrder) {
  const SafetyConfig safety = sceneOf(kSpatialScene).safety;
  const char* names[] = {"muscle_1", "muscle_2", "muscle_3", "left", "muscle_5", "top"};
  const double lower[] = {0, 0, 0, 0, 1e4, 0}, upper[] = {3e5, 3e5, 3e5, 1e5, 9e4, 1e5};
  ASSERT_EQ(safety.channels.size(), 6u);
  for (int i = 0; i < 6; ++i) {
    EXPECT_EQ(safety.channels[i].name, names[i]);
    EXPECT_EQ(safety.channels[i].limits.lower, lower[i]);
    EXPECT_EQ(safety.channels[i].limits.upper, upper[i]);
    EXPECT_EQ(safety.channels[i].slew, 2e5);
    EXPECT_EQ(safety.channels[i].action, control::FaultAction::kHold);
  }
  const control::SafetyCore accepted(safety.channels, safety.rules);
}

TEST(PressureScene, OmittedKeysHaveTheDefaultsOfTheRules) {
  const control::SafetyRules usual;
  const SafetyConfig safety =
      sceneOf(kPlanarScene + "regulator: {simulated: {}}\nsafety: {}\n").safety;
  EXPECT_EQ(safety.rules.target_timeout, usual.target_timeout);
  EXPECT_EQ(safety.rules.reading_timeout, usual.reading_timeout);
  EXPECT_EQ(safety.rules.trip_margin, usual.trip_margin);
  EXPECT_EQ(safety.rules.min_supply, std::nullopt);
  EXPECT_EQ(safety.rules.follow_tolerance, usual.follow_tolerance);
  EXPECT_EQ(safety.rules.leak_drop, usual.leak_drop);
  EXPECT_EQ(safety.rules.vented_below, usual.vented_below);
  for (const control::ChannelRules& channel : safety.channels) {
    EXPECT_EQ(channel.slew, kInfinity);
    EXPECT_EQ(channel.action, control::FaultAction::kVent);
  }
}

TEST(PressureScene, HardwareMovesSlowlyUnlessToldOtherwise) {
  for (const std::string& text : {kSerialScene, kModbusScene}) {
    for (const control::ChannelRules& channel : sceneOf(text).safety.channels) {
      EXPECT_EQ(channel.slew, 3e5);
    }
    for (const control::ChannelRules& channel :
         sceneOf(text, {{"safety.slew_kpa_s", "50"}}).safety.channels) {
      EXPECT_EQ(channel.slew, 5e4);
    }
  }
}

TEST(PressureScene, OnlyASimulatedRegulatorMayWaitForTargetsWithoutLimit) {
  const std::vector<Override> for_ever = {{"safety.target_timeout_s", "0"}};
  EXPECT_EQ(sceneOf(kSpatialScene, for_ever).safety.rules.target_timeout, kInfinity);
  EXPECT_FALSE(faultsOf(kSerialScene, for_ever).empty());
  EXPECT_FALSE(faultsOf(kPlanarScene, for_ever).empty());  // nobody knows what its air comes from
}

TEST(PressureScene, ActionsMayDiffer) {
  const SafetyConfig safety =
      sceneOf(kSpatialScene, {{"safety.fault_action", "{left: close, muscle_2: hold}"}}).safety;
  const auto vent = control::FaultAction::kVent;
  EXPECT_EQ(safety.channels[0].action, vent);
  EXPECT_EQ(safety.channels[1].action, control::FaultAction::kHold);
  EXPECT_EQ(safety.channels[3].action, control::FaultAction::kClose);
  EXPECT_EQ(safety.channels[5].action, vent);
}

TEST(PressureScene, ValvesThatCannotBeClosedAreNot) {
  const std::string scene =
      kPlanarScene + "regulator: {ascii_serial: {profile: ctrl_p, device: /dev/ttyACM0}}\n";
  EXPECT_EQ(faultsOf(scene + "safety: {fault_action: hold}\n"), Faults{});
  const char* said =
      " is close, but the valves of ascii_serial ctrl_p at /dev/ttyACM0 cannot be closed; expected "
      "vent or hold";
  EXPECT_EQ(faultsOf(scene + "safety: {fault_action: close}\n"),
            Faults{std::string(":12 safety.fault_action") + said});
  EXPECT_EQ(faultsOf(scene + "safety: {fault_action: {muscle_1: close}}\n"),
            Faults{std::string(":12 safety.fault_action.muscle_1") + said});
}

TEST(PressureScene, AVacuumIsWithinTheLimits) {
  const SafetyConfig safety =
      sceneOf(replaced(kPlanarScene, "pressure_kpa: [0, 400]", "pressure_kpa: [-60, 0]")).safety;
  EXPECT_EQ(safety.channels[0].limits.lower, -6e4);
  EXPECT_EQ(safety.channels[0].limits.upper, 0);
  const std::string tight = "safety: {trip_margin_kpa: 5}\n";
  EXPECT_EQ(
      faultsOf(replaced(kPlanarScene, "pressure_kpa: [0, 400]", "pressure_kpa: [-60, 0]") + tight),
      Faults{":11 safety.vented_below_kpa is 15 by default; expected less than 5, "
             "where muscle_1 is beyond its limits by safety.trip_margin_kpa"});
}

TEST(PressureScene, AnArmWithTendonsHasNoChannels) {
  const Scene scene = sceneOf(replaced(
      replaced(replaced(kSpatialScene, "contraction: muscle, max_pressure_kpa: 300",
                        "contraction: cable"),
               "regulator:\n  simulated: {time_constant_s: 0.2, supply_kpa: 450, noise_kpa: 2, "
               "seed: 7}\n",
               ""),
      "target_timeout_s: 2, ", ""));
  EXPECT_TRUE(scene.safety.channels.empty());
}

TEST(PressureScene, ASerialRegulatorHasItsProfile) {
  const Scene scene = sceneOf(kSerialScene);
  const auto& serial = std::get<regulator::SerialConfig>(scene.regulator.value());
  EXPECT_EQ(serial.profile.name, "generic");
  EXPECT_NO_THROW(serial.profile.validate());
  EXPECT_EQ(serial.device, "/dev/ttyUSB0");
  EXPECT_EQ(serial.addresses, (Faults{"a", "b"}));
  EXPECT_EQ(scene.safety.channels[0].action, control::FaultAction::kVent);
  EXPECT_EQ(scene.safety.channels[1].action, control::FaultAction::kClose);
}

TEST(PressureScene, AModbusRegulatorHasItsProfile) {
  const Scene scene = sceneOf(kModbusScene);
  const auto& modbus = std::get<regulator::ModbusConfig>(scene.regulator.value());
  EXPECT_EQ(modbus.profile.name, "festo_vtem");
  EXPECT_NO_THROW(modbus.profile.validate());
  EXPECT_EQ(modbus.host, "terminal");
  EXPECT_EQ(modbus.port, 1502);
  EXPECT_EQ(modbus.slots, (std::vector<int>{3, 1}));
  const Scene usual = sceneOf(
      kPlanarScene + "regulator: {modbus_tcp: {profile: festo_vtem, host: 192.168.1.10}}\n");
  const auto& defaults = std::get<regulator::ModbusConfig>(usual.regulator.value());
  EXPECT_EQ(defaults.port, 502);
  EXPECT_EQ(defaults.slots, (std::vector<int>{0, 1}));
}

TEST(PressureScene, ACustomProfileIsRelativeToTheScene) {
  const TemporaryFolder folder;
  const std::string shipped = HELIX_ARM_SOURCE_DIR "/config/regulators/generic.yaml";
  std::filesystem::copy_file(shipped, folder / "board.yaml");
  const std::string scene = replaced(kSerialScene, "profile: generic", "profile: board.yaml");
  write(folder / "scene.yaml", scene);
  const auto nameOf = [](const Scene& loaded) {
    return std::get<regulator::SerialConfig>(loaded.regulator.value()).profile.name;
  };
  EXPECT_EQ(nameOf(loadScene(folder / "scene.yaml")), "board");

  // A copy of the scene elsewhere names the same file.
  const TemporaryFolder elsewhere;
  write(elsewhere / "copy.yaml", sceneText(folder / "scene.yaml"));
  EXPECT_EQ(nameOf(loadScene(elsewhere / "copy.yaml")), "board");
  write(elsewhere / "copy.yaml", sceneText(folder / "scene.yaml", {{"name", "copy"}}));
  EXPECT_EQ(nameOf(loadScene(elsewhere / "copy.yaml")), "board");
}

TEST(PressureScene, FaultsOfAProfileNameItsOwnFileAndLine) {
  const TemporaryFolder folder;
  const std::string file = folder / "scene.yaml", board = folder / "board.yaml";
  write(file, replaced(kSerialScene, "profile: generic", "profile: ./board.yaml"));
  const std::string said = file + ":11 regulator.ascii_serial.profile is " + folder.path() +
                           "/./board.yaml, which has faults:\n" + folder.path() + "/./board.yaml";
  EXPECT_EQ(faultsOfFile(file), said + " cannot be read: No such file or directory");
  write(board, "ascii_serial: {\n");
  EXPECT_EQ(faultsOfFile(file).find(said + ":2 is not YAML: "), 0u) << faultsOfFile(file);
  write(board, "ascii_serail: {}\n");
  EXPECT_EQ(faultsOfFile(file),
            said +
                ":1 the document is a map of other keys; expected a map of ascii_serial or "
                "modbus_tcp");
  write(board, "# mine\nmodbus_tcp: {}\n");
  EXPECT_EQ(
      faultsOfFile(file),
      said +
          ":2 modbus_tcp is not the scene's kind of regulator; expected a profile of ascii_serial");
  write(board, "ascii_serial:\n  baud: fast\n");
  EXPECT_NE(faultsOfFile(file).find("/board.yaml:2 ascii_serial.baud is fast"), std::string::npos)
      << faultsOfFile(file);
}

}  // namespace
}  // namespace helix_arm::io
