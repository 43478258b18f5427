#include "modbus_profile_reader.hpp"

#include "helix_arm/io/number.hpp"
#include "map_reader.hpp"
#include "profile_checks.hpp"

namespace helix_arm::io {
namespace {

constexpr int kHighestWord = 0xffff;
constexpr int kLongestStride = 1024;

const NumberRule kCount = within(kPositive, 1e-3, 1e6, " Pa");
const NumberRule kActivationTime = within(kPositive, 0.01, 60, " s");

// A required whole number; an invalid one is reported.
int word(const MapReader& keys, const std::string& key, int lowest = 0,
         int highest = kHighestWord) {
  return static_cast<int>(keys.integer(key, lowest, highest).value_or(lowest));
}

void readOutputs(const Value& value, const std::string& path, regulator::ModbusProfile& profile,
                 FaultList& faults) {
  const MapReader keys(value, path, {"first", "stride", "pressure"}, faults);
  profile.output_base = word(keys, "first");
  profile.output_stride = word(keys, "stride", 1, kLongestStride);
  profile.output_pressure = word(keys, "pressure", 0, kLongestStride - 1);
}

void readInputs(const Value& value, const std::string& path, regulator::ModbusProfile& profile,
                FaultList& faults) {
  const MapReader keys(value, path, {"first", "stride", "pressure", "registers"}, faults);
  profile.input_base = word(keys, "first");
  profile.input_stride = word(keys, "stride", 1, kLongestStride);
  profile.input_pressure = word(keys, "pressure", 0, kLongestStride - 1);
  profile.input_registers = keys.choice("registers", {"holding", "input"}) == "input";
}

regulator::ModbusApp readApp(const Value& value, const std::string& path, FaultList& faults) {
  const MapReader keys(value, path,
                       {"command", "regulate", "off", "acknowledge", "status", "status_mask",
                        "ready", "running", "activation_time_s"},
                       faults);
  regulator::ModbusApp app;
  app.command = word(keys, "command", 0, kLongestStride - 1);
  app.regulate = word(keys, "regulate");
  app.off = word(keys, "off");
  app.acknowledge = word(keys, "acknowledge");
  app.status = word(keys, "status", 0, kLongestStride - 1);
  app.status_mask = static_cast<int>(keys.integer("status_mask", 1, kHighestWord, app.status_mask));
  app.ready = word(keys, "ready");
  app.running = word(keys, "running");
  app.activation_time = keys.number("activation_time_s", kActivationTime, app.activation_time);
  return app;
}

}  // namespace

std::optional<regulator::ModbusProfile> readModbusProfile(const Value& value,
                                                          const std::string& path,
                                                          const std::string& name,
                                                          FaultList& faults) {
  const std::size_t before = faults.count();
  const MapReader keys(value, path,
                       {"unit_id", "count_pa", "atmosphere_kpa", "highest_count", "outlets",
                        "channels", "outputs", "inputs", "supply", "app", "timeout_s"},
                       faults);
  regulator::ModbusProfile profile;
  profile.name = name;
  profile.unit_id = static_cast<int>(keys.integer("unit_id", 0, 255, profile.unit_id));
  profile.pascals = keys.number("count_pa", kCount).value_or(profile.pascals);
  profile.atmosphere = pascals(keys.number("atmosphere_kpa", kAtmosphere, 0.0));
  profile.highest_count = word(keys, "highest_count", 1, 32767);
  profile.outlets = static_cast<int>(keys.integer("outlets", 1, 64, profile.outlets));
  if (keys.has("channels")) profile.channels = word(keys, "channels", 1, kMostProfileChannels);
  if (const Value* outputs = keys.required("outputs", "a map of first, stride and pressure")) {
    readOutputs(*outputs, keys.path("outputs"), profile, faults);
  }
  if (const Value* inputs =
          keys.required("inputs", "a map of first, stride, pressure and registers")) {
    readInputs(*inputs, keys.path("inputs"), profile, faults);
  }
  if (keys.has("supply")) profile.supply = word(keys, "supply");
  if (const Value* app = value.find("app")) profile.app = readApp(*app, keys.path("app"), faults);
  profile.timeout = keys.number("timeout_s", kTimeout, profile.timeout);
  return checked(profile, value, path, before, faults);
}

}  // namespace helix_arm::io
