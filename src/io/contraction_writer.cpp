#include "contraction_writer.hpp"

#include <algorithm>
#include <utility>
#include <vector>

#include "actuator_entries.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/number.hpp"
#include "map_reader.hpp"
#include "response_reader.hpp"
#include "value_writer.hpp"

namespace helix_arm::io {
namespace {

// Given limits that exceed the range of a new curve.
void findLimitsBeyond(const std::string& name, const model::Range& range,
                      const std::vector<ActuatorEntry>& entries, FaultList& faults) {
  for (const ActuatorEntry& entry : entries) {
    if (entry.keys->find("contraction")->text != name) continue;
    for (const char* key : {"min_pressure_kpa", "max_pressure_kpa"}) {
      const Value* limit = entry.keys->find(key);
      if (limit == nullptr || range.contains(pascals(*parseNumber(limit->text)))) continue;
      report(faults, limit->place,
             joinPath(entry.path, key) + " is " + limit->text +
                 "; expected a pressure where the new curve of " + name + " was measured, " +
                 formatNumber(kilopascals(range.lower)) + " to " +
                 formatNumber(kilopascals(range.upper)) +
                 ": move the limit there, or measure the free length as far as that");
    }
  }
}

Value curveValue(const estimation::ContractionFit& fit) {
  const auto inKilopascals = [](const std::vector<double>& pressures) {
    Eigen::VectorXd kpa(static_cast<int>(pressures.size()));
    std::transform(pressures.begin(), pressures.end(), kpa.begin(), &kilopascals);
    return kpa;
  };
  MapWriter curve, value;
  switch (fit.kind) {
    case estimation::CurveKind::kQuintic:
      curve.numbers("coefficients_m",
                    Eigen::Map<const Eigen::VectorXd>(fit.coefficients.data(),
                                                      static_cast<int>(fit.coefficients.size())));
      curve.number("reference_pressure_kpa", kilopascals(fit.reference_pressure));
      curve.number("max_pressure_kpa", kilopascals(fit.reference_pressure));
      value.set("quintic", curve.value());
      break;
    case estimation::CurveKind::kTable:
    case estimation::CurveKind::kSpline:
      curve.numbers("pressure_kpa", inKilopascals(fit.pressures));
      curve.numbers("length_m", Eigen::Map<const Eigen::VectorXd>(
                                    fit.lengths.data(), static_cast<int>(fit.lengths.size())));
      value.set("table", curve.value());
      break;
  }
  return value.value();
}

// The map of a contraction by name.
Value& contractionOf(const Scene& scene, const std::string& name, Value& document) {
  Value& contractions = *findValue(document, "contractions");
  Value* const present = findValue(contractions, name);
  std::vector<std::string> known;
  for (const Value::Entry& entry : contractions.entries) known.push_back(entry.key);
  basics::require(present != nullptr, "calibratedSceneText: scene ", scene.name,
                  " has no contraction ", name, "; expected ", alternatives(known));
  basics::require(present->find("tendon") == nullptr, "calibratedSceneText: contraction ", name,
                  " of scene ", scene.name, " is a tendon; expected one that pressure drives");
  return *present;
}

}  // namespace

void putContraction(const Scene& scene, const std::string& name,
                    const estimation::ContractionFit& fit, Value& document, FaultList& faults) {
  basics::require(fit.curve.has_value(), "calibratedSceneText: contraction ", name,
                  " has no curve: ", fit.reason);
  Value& contraction = contractionOf(scene, name, document);
  findLimitsBeyond(name, fit.curve->inputRange(), actuatorEntries(document), faults);
  Value changed = curveValue(fit);
  if (const Value* response = contraction.find(kResponseKey)) {
    setValue(changed, kResponseKey, *response);
  }
  contraction = std::move(changed);
  // Scale factors of the old curve do not apply to the new one.
  for (const ActuatorEntry& entry : actuatorEntries(document)) {
    const bool scaled = entry.keys->find("length_scale") != nullptr;
    if (scaled && entry.keys->find("contraction")->text == name) {
      setValue(*entry.keys, "length_scale", numberValue(1));
    }
  }
}

void putResponse(const Scene& scene, const std::string& name, const model::Response& response,
                 Value& document) {
  Value& contraction = contractionOf(scene, name, document);
  if (response.instant()) {
    eraseValue(contraction, kResponseKey);
    return;
  }
  MapWriter keys;
  keys.number("rise_time_constant_s", response.rise_time);
  keys.number("fall_time_constant_s", response.fall_time);
  if (response.play_count > 0) {
    Eigen::VectorXd reach(response.play_count), weight(response.play_count);
    for (int j = 0; j < response.play_count; ++j) {
      const model::Response::Play& play = response.plays[static_cast<std::size_t>(j)];
      reach[j] = kilopascals(play.reach);
      weight[j] = play.weight;
    }
    keys.numbers("play_kpa", reach);
    keys.numbers("play_weight", weight);
  }
  setValue(contraction, kResponseKey, keys.value());
}

}  // namespace helix_arm::io
