#include "helix_arm/regulator/modbus_profile.hpp"

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::regulator {

void ModbusProfile::validate() const {
  constexpr int kHighestWord = 0xffff;
  const std::string culprit = "profile " + name;
  const auto require = [&](bool holds, const char* what, const auto& value, const auto& rule) {
    basics::requireValue(holds, culprit.c_str(), what, value, rule);
  };
  const auto within = [&](const char* what, double value, double lowest, double highest) {
    basics::require(value >= lowest && value <= highest, culprit, ": ", what, " is ", value,
                    "; expected ", lowest, " to ", highest);
  };
  within("unit_id", unit_id, 0, 255);
  within("count_pa", pascals, 1e-3, 1e6);
  within("atmosphere_kpa", atmosphere / 1e3, 0, 200);
  within("highest_count", highest_count, 1, 32767);
  within("outlets", outlets, 1, 64);
  if (channels) within("channels", *channels, 1, 1024);
  within("outputs.first", output_base, 0, kHighestWord);
  within("outputs.stride", output_stride, 1, 1024);
  within("outputs.pressure", output_pressure, 0, output_stride - 1);
  within("inputs.first", input_base, 0, kHighestWord);
  within("inputs.stride", input_stride, 1, 1024);
  within("inputs.pressure", input_pressure, 0, input_stride - 1);
  require(output_pressure + outlets <= output_stride, "outlets", outlets,
          "as many as set points fit into outputs.stride");
  require(input_pressure + outlets <= input_stride, "outlets", outlets,
          "as many as readings fit into inputs.stride");
  if (supply) within("supply", *supply, 0, kHighestWord);
  within("timeout_s", timeout, 1e-3, 10);
  if (!app) return;
  within("app.command", app->command, 0, output_stride - 1);
  within("app.status", app->status, 0, input_stride - 1);
  const auto apart = [this](int word, int first) {
    return word < first || word >= first + outlets;
  };
  require(apart(app->command, output_pressure), "app.command", app->command,
          "a register other than the set point's");
  require(apart(app->status, input_pressure), "app.status", app->status,
          "a register other than the reading's");
  within("app.regulate", app->regulate, 0, kHighestWord);
  within("app.off", app->off, 0, kHighestWord);
  within("app.acknowledge", app->acknowledge, 0, kHighestWord);
  within("app.status_mask", app->status_mask, 1, kHighestWord);
  const auto masked = [this](int word) { return word >= 0 && (word & app->status_mask) == word; };
  require(masked(app->ready), "app.ready", app->ready, "only bits of app.status_mask");
  require(masked(app->running), "app.running", app->running, "only bits of app.status_mask");
  require(app->running != app->ready, "app.running", app->running, "another word than ready");
  require(app->off != app->regulate, "app.off", app->off, "another word than regulate");
  within("app.activation_time_s", app->activation_time, 0.01, 60);
}

}  // namespace helix_arm::regulator
