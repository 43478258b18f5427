// What a scene says of the pressure path: regulators, their profiles, and safety.

#include <cmath>
#include <fstream>

#include <gtest/gtest.h>

#include "scene_faults.hpp"
#include "support/scene_text.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::io {
namespace {

using test::BrokenRule;
using test::faultsOf;
using test::kPlanarScene;
using test::kSpatialScene;
using test::replaced;
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

Scene load(const std::string& text, const std::vector<Override>& overrides = {}) {
  return loadScene(test::TemporaryFile(text).path(), overrides);
}

void write(const std::string& path, const std::string& text) { std::ofstream(path) << text; }

std::string faultsOfFile(const std::string& path) {
  try {
    loadScene(path);
  } catch (const DocumentError& error) {
    return error.what();
  }
  return "";
}

class PressureRules : public testing::TestWithParam<BrokenRule> {};
TEST_P(PressureRules, BreakingOneIsReported) {
  ASSERT_TRUE(faultsOf(kSpatialScene).empty());
  EXPECT_EQ(faultsOf(replaced(kSpatialScene, GetParam().from, GetParam().to)), GetParam().faults);
}

const BrokenRule kSafety[] = {
    {"target_timeout_s: 2",
     "target_timeout_s: -1",
     {":34 safety.target_timeout_s is -1; expected a finite value >= 0"}},
    {"target_timeout_s: 2",
     "target_timeout_s: 1000000",
     {":34 safety.target_timeout_s is 1000000; expected 0 to 3600 s"}},
    {"reading_timeout_s: 0.4",
     "reading_timeout_s: 0",
     {":34 safety.reading_timeout_s is 0; expected a finite value > 0"}},
    {"slew_kpa_s: 200",
     "slew_kpa_s: 0",
     {":34 safety.slew_kpa_s is 0; expected a finite value > 0"}},
    {"slew_kpa_s: 200",
     "slew_kpa_s: .inf",
     {":34 safety.slew_kpa_s is .inf; expected a finite value > 0"}},
    {"trip_margin_kpa: 20",
     "trip_margin_kpa: -1",
     {":34 safety.trip_margin_kpa is -1; expected a finite value >= 0"}},
    {"trip_margin_kpa: 20, ",
     "trip_margin_kpa: 20, trip_margin_kpa: 20, ",
     {":34 safety.trip_margin_kpa is given twice; expected it once"}},
    {"spike_time_s: 0.2",
     "spike_time_s: -0.1",
     {":34 safety.spike_time_s is -0.1; expected a finite value >= 0"}},
    {"min_supply_kpa: 300",
     "min_supply_kpa: 0",
     {":34 safety.min_supply_kpa is 0; expected a finite value > 0"}},
    {"tolerance_kpa: 50",
     "tolerance_kpa: 0",
     {":34 safety.follow.tolerance_kpa is 0; expected a finite value > 0"}},
    {"time_s: 1.5", "time_s: 0", {":34 safety.follow.time_s is 0; expected a finite value > 0"}},
    {"time_constant_s: 0.3",
     "time_constant_s: fast",
     {":34 safety.follow.time_constant_s is fast; expected a finite value > 0"}},
    {"time_constant_s: 0.3",
     "time_constant_s: 0.3, fall_time_constant_s: 0",
     {":34 safety.follow.fall_time_constant_s is 0; expected a finite value > 0"}},
    {"tolerance_kpa: 50",
     "tolerance_kp: 50",
     {":34 safety.follow.tolerance_kp is not a known key; did you mean tolerance_kpa?"}},
    {"leak_drop_kpa: 15",
     "leak_drop_kpa: 0",
     {":34 safety.leak_drop_kpa is 0; expected a finite value > 0"}},
    {"fault_action: hold",
     "fault_action: stop",
     {":34 safety.fault_action is stop; expected vent, hold or close"}},
    {"fault_action: hold",
     "fault_action: [hold]",
     {":34 safety.fault_action is a list; expected vent, hold or close"}},
    {"fault_action: hold",
     "fault_action: {muscle_9: hold}",
     {":34 safety.fault_action.muscle_9 is not a known key; did you mean muscle_1?"}},
    {"fault_action: hold",
     "fault_action: {left: stay}",
     {":34 safety.fault_action.left is stay; expected vent, hold or close"}},
    {"hold_time_s: 5",
     "hold_time_s: -1",
     {":34 safety.hold_time_s is -1; expected a finite value >= 0"}},
    {"vented_below_kpa: 12",
     "vented_below_kpa: 0",
     {":34 safety.vented_below_kpa is 0; expected a finite value > 0"}},
    {"vented_below_kpa: 12",
     "vented_below_kpa: 110",
     {":34 safety.vented_below_kpa is 110; expected less than 110, where muscle_5 is beyond its "
      "limits by safety.trip_margin_kpa"}},
    {"vent_time_s: 4",
     "vent_time_s: 0",
     {":34 safety.vent_time_s is 0; expected a finite value > 0"}},
    {"vent_time_s: 4",
     "vent_tme_s: 4",
     {":34 safety.vent_tme_s is not a known key; did you mean vent_time_s?"}},
    {"  simulated: {",
     "  simulated: {}\n  ascii_serial: {",
     {":32 regulator has simulated and ascii_serial; expected exactly one of simulated, "
      "ascii_serial or modbus_tcp"}},
    {"  simulated: {",
     "  simulatd: {",
     {":33 regulator.simulatd is not a known key; did you mean simulated?",
      ":32 regulator has none; expected exactly one of simulated, ascii_serial or modbus_tcp"}},
};
INSTANTIATE_TEST_SUITE_P(Safety, PressureRules, testing::ValuesIn(kSafety));

class SerialRules : public testing::TestWithParam<BrokenRule> {};
TEST_P(SerialRules, BreakingOneIsReported) {
  ASSERT_TRUE(faultsOf(kSerialScene).empty());
  EXPECT_EQ(faultsOf(replaced(kSerialScene, GetParam().from, GetParam().to)), GetParam().faults);
}

const BrokenRule kSerial[] = {
    {"profile: generic",
     "profile: generik",
     {":11 regulator.ascii_serial.profile is generik; expected alicat, ctrl_p, festo_mpa, "
      "festo_vtem or generic, or a path (with a / or ending in .yaml) from the scene's folder"}},
    {"profile: generic, ",
     "",
     {":11 regulator.ascii_serial.profile is missing; expected alicat, ctrl_p, festo_mpa, "
      "festo_vtem or generic, or a path (with a / or ending in .yaml) from the scene's folder"}},
    {"device: /dev/ttyUSB0, ",
     "",
     {":11 regulator.ascii_serial.device is missing; expected a serial port like /dev/ttyUSB0"}},
    {"device: /dev/ttyUSB0",
     "device: ''",
     {":11 regulator.ascii_serial.device is \"\"; expected a serial port like /dev/ttyUSB0"}},
    {", addresses: [a, b]",
     "",
     {":11 regulator.ascii_serial.addresses is missing; profile generic addresses each channel: "
      "expected 2 entries, one per actuator"}},
    {"addresses: [a, b]",
     "addresses: [a, b, c]",
     {":11 regulator.ascii_serial.addresses has 3 entries; expected 2 entries, one per actuator"}},
    {"addresses: [a, b]",
     "addresses: a",
     {":11 regulator.ascii_serial.addresses is a; expected a list of words, one per actuator"}},
    {"addresses: [a, b]",
     "addresses: [a, a]",
     {":11 regulator.ascii_serial.addresses[1] is a; expected one that no other actuator has"}},
    {"addresses: [a, b]",
     "addresses: [a, b c]",
     {":11 regulator.ascii_serial.addresses[1] is b c; expected a word without spaces"}},
    {"profile: generic",
     "profile: ctrl_p",
     {":11 regulator.ascii_serial.addresses is not used: the lines of profile ctrl_p have no "
      "{address}; expected none"}},
    {"muscle_2: close",
     "muscle_3: close",
     {":12 safety.fault_action.muscle_3 is not a known key; did you mean muscle_1?"}},
    {"fault_action: {muscle_2: close}",
     "target_timeout_s: 0",
     {":12 safety.target_timeout_s is 0; expected a finite value > 0: only a simulated regulator "
      "may wait for targets without limit"}},
};
INSTANTIATE_TEST_SUITE_P(Serial, SerialRules, testing::ValuesIn(kSerial));

class ModbusRules : public testing::TestWithParam<BrokenRule> {};
TEST_P(ModbusRules, BreakingOneIsReported) {
  ASSERT_TRUE(faultsOf(kModbusScene).empty());
  EXPECT_EQ(faultsOf(replaced(kModbusScene, GetParam().from, GetParam().to)), GetParam().faults);
}

const BrokenRule kModbus[] = {
    {"host: terminal, ",
     "",
     {":11 regulator.modbus_tcp.host is missing; expected a name or address"}},
    {"port: 1502",
     "port: 0",
     {":11 regulator.modbus_tcp.port is 0; expected a whole number from 1 to 65535"}},
    {"slots: [3, 1]",
     "slots: [3]",
     {":11 regulator.modbus_tcp.slots has 1 entries; expected a list of 2 numbers, each a finite "
      "value >= 0"}},
    {"slots: [3, 1]",
     "slots: [3, 3]",
     {":11 regulator.modbus_tcp.slots is a list; expected distinct whole numbers"}},
    {"slots: [3, 1]",
     "slots: [3, 0.5]",
     {":11 regulator.modbus_tcp.slots is a list; expected distinct whole numbers"}},
    {"slots: [3, 1]",
     "slots: [3, -1]",
     {":11 regulator.modbus_tcp.slots[1] is -1; expected a finite value >= 0"}},
    {"pressure_kpa: [0, 400]",
     "pressure_kpa: [-50, 400]",
     {":11 regulator.modbus_tcp.profile is festo_vtem, which accepts 0 to 700 kPa; expected limits "
      "within that, not muscle_1's of -50 to 400 kPa",
      ":11 regulator.modbus_tcp.profile is festo_vtem, which accepts 0 to 700 kPa; expected limits "
      "within that, not muscle_2's of -50 to 400 kPa"}},
};
INSTANTIATE_TEST_SUITE_P(Modbus, ModbusRules, testing::ValuesIn(kModbus));

TEST(PressureScene, SafetyIsInSi) {
  const SafetyConfig safety = load(kSpatialScene).safety;
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
  const SafetyConfig safety = load(kSpatialScene).safety;
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
      load(kPlanarScene + "regulator: {simulated: {}}\nsafety: {}\n").safety;
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
    for (const control::ChannelRules& channel : load(text).safety.channels) {
      EXPECT_EQ(channel.slew, 3e5);
    }
    for (const control::ChannelRules& channel :
         load(text, {{"safety.slew_kpa_s", "50"}}).safety.channels) {
      EXPECT_EQ(channel.slew, 5e4);
    }
  }
}

TEST(PressureScene, OnlyASimulatedRegulatorMayWaitForTargetsWithoutLimit) {
  const std::vector<Override> for_ever = {{"safety.target_timeout_s", "0"}};
  EXPECT_EQ(load(kSpatialScene, for_ever).safety.rules.target_timeout, kInfinity);
  EXPECT_FALSE(faultsOf(kSerialScene, for_ever).empty());
  EXPECT_FALSE(faultsOf(kPlanarScene, for_ever).empty());  // nobody knows what its air comes from
}

TEST(PressureScene, ActionsMayDiffer) {
  const SafetyConfig safety =
      load(kSpatialScene, {{"safety.fault_action", "{left: close, muscle_2: hold}"}}).safety;
  const auto vent = control::FaultAction::kVent;
  EXPECT_EQ(safety.channels[0].action, vent);
  EXPECT_EQ(safety.channels[1].action, control::FaultAction::kHold);
  EXPECT_EQ(safety.channels[3].action, control::FaultAction::kClose);
  EXPECT_EQ(safety.channels[5].action, vent);
}

TEST(PressureScene, ValvesThatCannotBeClosedAreNot) {
  const std::string scene =
      kPlanarScene + "regulator: {ascii_serial: {profile: ctrl_p, device: /dev/ttyACM0}}\n";
  EXPECT_EQ(faultsOf(scene + "safety: {fault_action: hold}\n"), std::vector<std::string>{});
  const char* said =
      " is close, but the valves of ascii_serial ctrl_p at /dev/ttyACM0 cannot be closed; expected "
      "vent or hold";
  EXPECT_EQ(faultsOf(scene + "safety: {fault_action: close}\n"),
            std::vector<std::string>{std::string(":12 safety.fault_action") + said});
  EXPECT_EQ(faultsOf(scene + "safety: {fault_action: {muscle_1: close}}\n"),
            std::vector<std::string>{std::string(":12 safety.fault_action.muscle_1") + said});
}

TEST(PressureScene, AVacuumIsWithinTheLimits) {
  const SafetyConfig safety =
      load(replaced(kPlanarScene, "pressure_kpa: [0, 400]", "pressure_kpa: [-60, 0]")).safety;
  EXPECT_EQ(safety.channels[0].limits.lower, -6e4);
  EXPECT_EQ(safety.channels[0].limits.upper, 0);
  const std::string tight = "safety: {trip_margin_kpa: 5}\n";
  EXPECT_EQ(
      faultsOf(replaced(kPlanarScene, "pressure_kpa: [0, 400]", "pressure_kpa: [-60, 0]") + tight),
      std::vector<std::string>{
          ":11 safety.vented_below_kpa is 15 by default; expected less than 5, "
          "where muscle_1 is beyond its limits by safety.trip_margin_kpa"});
}

TEST(PressureScene, AnArmWithTendonsHasNoChannels) {
  const Scene scene = load(replaced(
      replaced(replaced(kSpatialScene, "contraction: muscle, max_pressure_kpa: 300",
                        "contraction: cable"),
               "regulator:\n  simulated: {time_constant_s: 0.2, supply_kpa: 450, noise_kpa: 2, "
               "seed: 7}\n",
               ""),
      "target_timeout_s: 2, ", ""));
  EXPECT_TRUE(scene.safety.channels.empty());
}

TEST(PressureScene, ASerialRegulatorHasItsProfile) {
  const Scene scene = load(kSerialScene);
  const auto& serial = std::get<regulator::SerialConfig>(scene.regulator.value());
  EXPECT_EQ(serial.profile.name, "generic");
  EXPECT_NO_THROW(serial.profile.validate());
  EXPECT_EQ(serial.device, "/dev/ttyUSB0");
  EXPECT_EQ(serial.addresses, (std::vector<std::string>{"a", "b"}));
  EXPECT_EQ(scene.safety.channels[0].action, control::FaultAction::kVent);
  EXPECT_EQ(scene.safety.channels[1].action, control::FaultAction::kClose);
}

TEST(PressureScene, AModbusRegulatorHasItsProfile) {
  const Scene scene = load(kModbusScene);
  const auto& modbus = std::get<regulator::ModbusConfig>(scene.regulator.value());
  EXPECT_EQ(modbus.profile.name, "festo_vtem");
  EXPECT_NO_THROW(modbus.profile.validate());
  EXPECT_EQ(modbus.host, "terminal");
  EXPECT_EQ(modbus.port, 1502);
  EXPECT_EQ(modbus.slots, (std::vector<int>{3, 1}));
  const Scene usual =
      load(kPlanarScene + "regulator: {modbus_tcp: {profile: festo_vtem, host: 192.168.1.10}}\n");
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
