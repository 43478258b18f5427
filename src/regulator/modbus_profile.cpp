#include "helix_arm/regulator/modbus_profile.hpp"

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::regulator {
namespace {

constexpr int kHighestWord = 0xffff;

class Checker {
 public:
  explicit Checker(const std::string& name) : culprit_("profile " + name) {}

  template <class Value, class Rule>
  void require(bool holds, const char* what, const Value& value, const Rule& rule) const {
    basics::requireValue(holds, culprit_.c_str(), what, value, rule);
  }
  void within(const char* what, double value, double lowest, double highest) const {
    basics::require(value >= lowest && value <= highest, culprit_, ": ", what, " is ", value,
                    "; expected ", lowest, " to ", highest);
  }

 private:
  std::string culprit_;
};

void check(const ModbusProfile& profile, const ModbusApp& app, const Checker& checker) {
  checker.within("app.command", app.command, 0, profile.output_stride - 1);
  checker.within("app.status", app.status, 0, profile.input_stride - 1);
  const auto apart = [&profile](int word, int first) {
    return word < first || word >= first + profile.outlets;
  };
  checker.require(apart(app.command, profile.output_pressure), "app.command", app.command,
                  "a register other than the set point's");
  checker.require(apart(app.status, profile.input_pressure), "app.status", app.status,
                  "a register other than the reading's");
  checker.within("app.regulate", app.regulate, 0, kHighestWord);
  checker.within("app.off", app.off, 0, kHighestWord);
  checker.within("app.acknowledge", app.acknowledge, 0, kHighestWord);
  checker.within("app.status_mask", app.status_mask, 1, kHighestWord);
  const auto masked = [&app](int word) { return word >= 0 && (word & app.status_mask) == word; };
  checker.require(masked(app.ready), "app.ready", app.ready, "only bits of app.status_mask");
  checker.require(masked(app.running), "app.running", app.running, "only bits of app.status_mask");
  checker.require(app.running != app.ready, "app.running", app.running, "another word than ready");
  checker.require(app.off != app.regulate, "app.off", app.off, "another word than regulate");
  checker.within("app.activation_time_s", app.activation_time, 0.01, 60);
}

}  // namespace

void ModbusProfile::validate() const {
  const Checker checker(name);
  checker.within("unit_id", unit_id, 0, 255);
  checker.within("count_pa", pascals, 1e-3, 1e6);
  checker.within("atmosphere_kpa", atmosphere / 1e3, 0, 200);
  checker.within("highest_count", highest_count, 1, 32767);
  checker.within("outlets", outlets, 1, 64);
  if (channels) checker.within("channels", *channels, 1, 1024);
  checker.within("outputs.first", output_base, 0, kHighestWord);
  checker.within("outputs.stride", output_stride, 1, 1024);
  checker.within("outputs.pressure", output_pressure, 0, output_stride - 1);
  checker.within("inputs.first", input_base, 0, kHighestWord);
  checker.within("inputs.stride", input_stride, 1, 1024);
  checker.within("inputs.pressure", input_pressure, 0, input_stride - 1);
  checker.require(output_pressure + outlets <= output_stride, "outlets", outlets,
                  "as many as set points fit into outputs.stride");
  checker.require(input_pressure + outlets <= input_stride, "outlets", outlets,
                  "as many as readings fit into inputs.stride");
  if (supply) checker.within("supply", *supply, 0, kHighestWord);
  checker.within("timeout_s", timeout, 1e-3, 10);
  if (app) check(*this, *app, checker);
}

}  // namespace helix_arm::regulator
