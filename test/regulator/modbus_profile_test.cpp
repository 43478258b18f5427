#include "helix_arm/regulator/modbus_profile.hpp"

#include <functional>
#include <string>

#include <gtest/gtest.h>

#include "support/modbus_profiles.hpp"
#include "support/refusal.hpp"

namespace helix_arm::regulator {
namespace {

using test::mpaProfile;
using test::vtemProfile;

TEST(ModbusProfile, TheShippedOnesAreValid) {
  EXPECT_NO_THROW(vtemProfile().validate());
  EXPECT_NO_THROW(mpaProfile().validate());
  EXPECT_NO_THROW(ModbusProfile().validate());
}

// The sixteenth outlet is the second one of the eighth slot.
TEST(ModbusProfile, PlacesCountTheOutletsOfAllSlots) {
  const ModbusProfile vtem = vtemProfile();
  EXPECT_EQ(vtem.slot(15), 7);
  EXPECT_EQ(vtem.command(7), 40024);
  EXPECT_EQ(vtem.setPoint(14), 40025);
  EXPECT_EQ(vtem.setPoint(15), 40026);
  EXPECT_EQ(vtem.status(7), 45416);
  EXPECT_EQ(vtem.reading(15), 45418);
  const ModbusProfile mpa = mpaProfile();
  EXPECT_EQ(mpa.setPoint(3), 40006);
  EXPECT_EQ(mpa.reading(3), 45404);
}

TEST(ModbusProfile, EachBrokenRuleIsNamedWithItsValue) {
  const struct {
    std::function<void(ModbusProfile&)> breaks;
    const char* said;
  } kRules[] = {
      {[](auto& p) { p.unit_id = 256; }, "unit_id is 256; expected 0 to 255"},
      {[](auto& p) { p.unit_id = -1; }, "unit_id is -1; expected 0 to 255"},
      {[](auto& p) { p.pascals = 0; }, "count_pa is 0; expected 0.001 to 1e+06"},
      {[](auto& p) { p.pascals = std::stod("nan"); }, "count_pa is nan"},
      {[](auto& p) { p.atmosphere = -1e3; }, "atmosphere_kpa is -1; expected 0 to 200"},
      {[](auto& p) { p.highest_count = 0; }, "highest_count is 0; expected 1 to 32767"},
      {[](auto& p) { p.highest_count = 32768; }, "highest_count is 32768"},
      {[](auto& p) { p.outlets = 0; }, "outlets is 0; expected 1 to 64"},
      {[](auto& p) { p.outlets = 3; }, "outlets is 3; expected as many as set points fit"},
      {[](auto& p) {
         p.outlets = 1;
         p.output_pressure = 3;
       },
       "outputs.pressure is 3; expected 0 to 2"},
      {[](auto& p) { p.output_base = 65536; }, "outputs.first is 65536; expected 0 to 65535"},
      {[](auto& p) { p.output_stride = 0; }, "outputs.stride is 0; expected 1 to 1024"},
      {[](auto& p) { p.input_base = -1; }, "inputs.first is -1; expected 0 to 65535"},
      {[](auto& p) { p.input_stride = 1025; }, "inputs.stride is 1025; expected 1 to 1024"},
      {[](auto& p) { p.input_pressure = -1; }, "inputs.pressure is -1; expected 0 to 2"},
      {[](auto& p) { p.input_pressure = 2; }, "outlets is 2; expected as many as readings fit"},
      {[](auto& p) { p.supply = 70000; }, "supply is 70000; expected 0 to 65535"},
      {[](auto& p) { p.timeout = 0; }, "timeout_s is 0; expected 0.001 to 10"},
      {[](auto& p) { p.app->command = 3; }, "app.command is 3; expected 0 to 2"},
      {[](auto& p) { p.app->command = 2; },
       "app.command is 2; expected a register other than the set point's"},
      {[](auto& p) { p.app->status = 1; },
       "app.status is 1; expected a register other than the reading's"},
      {[](auto& p) { p.app->regulate = 65536; }, "app.regulate is 65536; expected 0 to 65535"},
      {[](auto& p) { p.app->off = -1; }, "app.off is -1; expected 0 to 65535"},
      {[](auto& p) { p.app->off = 195; }, "app.off is 195; expected another word than regulate"},
      {[](auto& p) { p.app->acknowledge = 1 << 16; }, "app.acknowledge is 65536"},
      {[](auto& p) { p.app->status_mask = 0; }, "app.status_mask is 0; expected 1 to 65535"},
      {[](auto& p) { p.app->ready = 256; },
       "app.ready is 256; expected only bits of app.status_mask"},
      {[](auto& p) { p.app->running = 256; }, "app.running is 256; expected only bits of"},
      {[](auto& p) { p.app->running = 125; },
       "app.running is 125; expected another word than ready"},
      {[](auto& p) { p.app->activation_time = 0; },
       "app.activation_time_s is 0; expected 0.01 to 60"},
  };
  for (const auto& rule : kRules) {
    ModbusProfile profile = vtemProfile();
    rule.breaks(profile);
    const std::string said = test::refusal([&profile] { profile.validate(); });
    EXPECT_EQ(said.find(std::string("profile festo_vtem: ") + rule.said), 0u)
        << said << "\nexpected " << rule.said;
  }
}

}  // namespace
}  // namespace helix_arm::regulator
