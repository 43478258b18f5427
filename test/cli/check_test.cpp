// `helix_arm check`.
#include <gtest/gtest.h>

#include "command.hpp"
#include "support/emulated_regulator.hpp"

namespace helix_arm::test {
namespace {

using nlohmann::json;

json findingOf(const json& result, const std::string& check) {
  for (const json& finding : result["findings"]) {
    if (finding["check"] == check) return finding;
  }
  return nullptr;
}

// The finding of a check that has to find something.
json foundBy(const json& result, const std::string& check) {
  const json finding = findingOf(result, check);
  if (finding.is_null()) throw std::runtime_error("no " + check + " in " + result.dump());
  return finding;
}

TEST(Check, ASoundRigPassesAndTellsWhatIsSeen) {
  const json result = resultOf({"check", scenePath("demo")});
  EXPECT_EQ(result["scene"], "demo");
  EXPECT_TRUE(result["passed"]);
  EXPECT_EQ(result["sight"]["measured"], 1.0);
  EXPECT_GT(result["sight"]["median_tags"], 6);
  EXPECT_GT(result["sight"]["pixels_per_bit"], 3);
  EXPECT_FALSE(result["probed"]);
  EXPECT_TRUE(result["supply_pa"].is_null());
}

TEST(Check, AFaultExitsWithOneInEveryFormat) {
  const auto run = [](const char* format) {
    return runCommand({"check", scenePath("demo"), "--set", "tags.groups.0.rpy_deg=[180,0,0]",
                       "--samples", "10", "--format", format});
  };
  const Outcome csv = run("csv");
  EXPECT_EQ(run("text").exit_code, 1);
  EXPECT_EQ(csv.exit_code, 1);
  EXPECT_EQ(csv.out.substr(0, 36), "severity,check,culprit,value,remedy\n");
  const json result = run("json").json();
  EXPECT_FALSE(result["passed"]);
  const json finding = findingOf(result, "tag_faces_inward");
  EXPECT_EQ(finding["severity"], "fault");
  EXPECT_EQ(finding["culprit"], "tags 0, 1, 2, 3, 4, 5, 6");
}

TEST(Check, ARegulatorThatDoesNotAnswerIsAFaultOnlyWhenAsked) {
  const std::string scene = scenePath("demo_serial"),
                    device = "regulator.ascii_serial.device=/tmp/no_such_regulator";
  EXPECT_EQ(runCommand({"check", scene, "--set", device}).exit_code, 0);
  const json result = resultOf({"check", scene, "--set", device, "--probe"}, 1);
  const json finding = foundBy(result, "no_answer");
  EXPECT_TRUE(has(finding["value"], "/tmp/no_such_regulator"));
  EXPECT_TRUE(result["probed"]);
}

// What a probe says of an emulated device with this fault.
json probed(Line line, simulation::DeviceFault fault) {
  EmulatedRegulator device(line);
  device.setFault(fault);
  const Outcome outcome = runCommand({"check", device.scene(), "--probe", "--format", "json"});
  const bool sound = fault == simulation::DeviceFault::kNone;
  EXPECT_EQ(outcome.exit_code, sound ? 0 : 1) << outcome.out << outcome.err;
  return outcome.json();
}

// A profile that takes gauge readings for pressures above a vacuum of 200 kPa.
TEST(Check, AReplyThatMakesNoSenseIsNamed) {
  std::string text = contentOf(HELIX_ARM_SOURCE_DIR "/config/regulators/festo_vtem.yaml");
  const std::string key = "modbus_tcp:\n";
  text.insert(text.find(key) + key.size(), "  atmosphere_kpa: 200\n");
  const TemporaryFile profile(text);
  const EmulatedRegulator device(Line::kModbus);
  const json result = resultOf({"check", device.scene(), "--probe", "--set",
                                "regulator.modbus_tcp.profile=" + profile.path()},
                               1);
  const json finding = foundBy(result, "bad_reply");
  EXPECT_EQ(finding["severity"], "fault");
  EXPECT_TRUE(has(finding["culprit"], " at 127.0.0.1:"));
  EXPECT_TRUE(has(finding["value"], "atmosphere_kpa"));
  EXPECT_EQ(finding["remedy"], "check the profile of the regulator");
}

TEST(Check, AChannelWithoutReadingIsNamed) {
  const auto modbus = Line::kModbus;
  EXPECT_TRUE(findingOf(probed(modbus, simulation::DeviceFault::kNone), "no_reading").is_null());
  const json finding = foundBy(probed(modbus, simulation::DeviceFault::kNanText), "no_reading");
  EXPECT_EQ(finding["severity"], "fault");
  EXPECT_EQ(finding["culprit"], "muscle_1");
}

TEST(Check, WhatTheRegulatorAnsweredIsSaid) {
  for (const Line line : kLines) {
    const json result = probed(line, simulation::DeviceFault::kNone);
    const std::string name = result["regulator"];
    EXPECT_EQ(name.find(kindOf(line).key + std::string(" ") + kindOf(line).profile + " at "), 0u);
    const json finding = foundBy(result, "answered");
    EXPECT_EQ(finding["severity"], "note");
    EXPECT_EQ(finding["culprit"], name);
    const std::string value = finding["value"];
    EXPECT_EQ(value.find("it vented and answered, gauge pressures: muscle_1 "), 0u) << value;
    for (const char* const said : {" kPa, muscle_2 ", " kPa, muscle_3 "}) {
      EXPECT_TRUE(has(value, said));
    }
    ASSERT_EQ(result["pressures_pa"].size(), 3u);
    for (const json& pressure : result["pressures_pa"]) EXPECT_LT(std::abs(double(pressure)), 2000);
    EXPECT_FALSE(findingOf(result, "supply_not_measured").is_null());
    EXPECT_TRUE(result["supply_pa"].is_null());
  }
}

TEST(Check, ASupplyThatIsMeasuredIsCompared) {
  const EmulatedRegulator device(Line::kSerial, EmulatedRegulator::Extra::kSupplySensor);
  const Outcome outcome =
      runCommand({"check", device.scene(), "--probe", "--format", "json", "--samples", "0"});
  const json result = outcome.json();
  ASSERT_FALSE(result["supply_pa"].is_null()) << outcome.out;
  EXPECT_TRUE(findingOf(result, "supply_not_measured").is_null());
  EXPECT_TRUE(has(findingOf(result, "answered")["value"], ", supply "));
}

}  // namespace
}  // namespace helix_arm::test
