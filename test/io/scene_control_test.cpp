// What a scene and profiles of regulators say of the pressure path and of the loop over vision;
// every rule broken once.

#include <fstream>
#include <tuple>

#include <gtest/gtest.h>

#include "basics/pi.hpp"
#include "io/scene/scene_readers.hpp"
#include "scene_faults.hpp"
#include "support/refusal.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::io {
namespace {

using follow::OnContact;
using namespace test;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Each regulator is at line 11, rules of safety at line 12.
const std::string kSerialScene = regulatorScenes().at("serial");
const std::string kModbusScene = regulatorScenes().at("modbus");

void write(const std::string& path, const std::string& text) { std::ofstream(path) << text; }

// Every key, from line 73 on.
const std::string kFollowScene = kSpatialScene + R"(follow:
  smoothing_s: 0.4
  mode_hz: 4
  mode_damping: 0.2
  stale_s: 0.5
  coast_s: 5
  hysteresis: 0.1
  creep: 0.3
  bias_translation_m: 0.004
  bias_rotation_deg: 3
  prefer: min-pressure
  on_contact: stop
  contact_limit: 40
  reading_noise_kpa: 1.5
  yield_timeout_s: 20
)";

TEST(ControlRules, BreakingOneIsReported) {
  for (const auto& [name, scene] : regulatorScenes()) expectFaults(name, scene);
  expectFaults("follow", kFollowScene);
}

TEST(PressureScene, SafetyIsInSi) {
  const SafetyConfig safety = sceneOf(kSpatialScene).safety;
  const control::SafetyRules& rules = safety.rules;
  EXPECT_EQ(safety.commander_timeout, 0.8);
  EXPECT_EQ(
      std::tie(rules.target_timeout, rules.reading_timeout, rules.trip_margin, rules.spike_time,
               rules.min_supply, rules.follow_tolerance, rules.follow_time, rules.time_constant,
               rules.leak_drop, rules.hold_time, rules.vented_below, rules.vent_time),
      std::make_tuple(2, 0.4, 2e4, 0.2, 3e5, 5e4, 1.5, 0.3, 1.5e4, 5, 1.2e4, 4));
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

TEST(PressureScene, AModbusRegulatorHasItsProfile) {
  const Scene scene = sceneOf(kModbusScene);
  const auto& modbus = std::get<regulator::ModbusConfig>(scene.regulator.value());
  EXPECT_EQ(modbus.profile.name, "festo_vtem");
  EXPECT_NO_THROW(modbus.profile.validate());
  EXPECT_EQ(modbus.host, "terminal");
  EXPECT_EQ(modbus.port, 1502);
  EXPECT_EQ(modbus.slots, (std::vector<int>{3, 1}));
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

TEST(FollowScene, IsInSi) {
  const follow::VisualServoConfig loop = sceneOf(kFollowScene).follow;
  EXPECT_EQ(membersOf(loop),
            std::make_tuple(0.4, 0.5, 5, 0.1 * 0.3, 1500, 0.1, 0.3, 1 / (2 * basics::kPi * 4 * 0.2),
                            0.004, OnContact::kStop, 40));
  EXPECT_EQ(loop.yield_timeout, 20);
  EXPECT_EQ(loop.preference, statics::Preference::kMinPressure);
  ASSERT_TRUE(loop.mode);
  EXPECT_EQ(loop.mode->frequency, 4);
  EXPECT_EQ(loop.mode->damping, 0.2);
  EXPECT_EQ(loop.time_constant, 0.3) << "of safety.follow";
  EXPECT_NEAR(loop.filter.bias_rotation, 3 * basics::kPi / 180, 1e-15);
  EXPECT_NO_THROW(loop.validate());
}

// ---- Profiles -----------------------------------------------------------------------------------

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

// Except for times and for the size of a device.
auto membersOf(const SerialProfile& p) {
  return std::tie(p.baud, p.terminator, p.pascals, p.atmosphere, p.unit_word, p.decimals,
                  p.separator, p.reply_separator, p.one_by_one, p.start, p.unit_query, p.unit_reply,
                  p.write, p.write_reply, p.read, p.reply, p.supply_line, p.skip, p.vent, p.close,
                  p.resume, p.vent_reply, p.checksum);
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
  unit_query: unit?
  unit_reply: "{unit}"
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
                            Faults{"hello", "echo off"}, "unit?", "{unit}", "set {pressures}", "ok",
                            "get", "{pressures} {unit}", "", Faults(), Faults{"stop", "vent"},
                            Faults(), Faults{"go"}, "done", true));
  EXPECT_EQ(profile.timeout, 0.25);
  EXPECT_EQ(profile.watchdog, 1.5);
  EXPECT_EQ(profile.highestPressure(), 250e3);
  EXPECT_EQ(profile.channels, 12);
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

TEST(ModbusProfileReader, EachBrokenRuleIsAFaultWithItsLine) {
  expectFaultsOf("modbus_profile", kModbus);
}

}  // namespace
}  // namespace helix_arm::io
