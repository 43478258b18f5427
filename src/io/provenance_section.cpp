#include "provenance_section.hpp"

#include <algorithm>
#include <limits>

#include "helix_arm/io/number.hpp"
#include "value_writer.hpp"

namespace helix_arm::io {
namespace {

constexpr std::size_t kHashDigits = 64;

bool isDigit(char c) { return c >= '0' && c <= '9'; }

// A UTC time in ISO 8601; the number of days of the month is not checked.
bool isUtcTime(const std::string& text) {
  const std::string form = "0000-00-00T00:00:00Z";
  if (text.size() != form.size()) return false;
  return std::equal(text.begin(), text.end(), form.begin(), [](char given, char wanted) {
    return wanted == '0' ? isDigit(given) : given == wanted;
  });
}

bool isHash(const std::string& text) {
  return text.size() == kHashDigits && std::all_of(text.begin(), text.end(), [](char c) {
           return isDigit(c) || (c >= 'a' && c <= 'f');
         });
}

// A text with a required format; empty if it does not match.
std::string formedText(const MapReader& keys, const std::string& key, const std::string& expected,
                       bool (*keeps)(const std::string&)) {
  std::string text = keys.text(key, expected).value_or("");
  if (!text.empty() && !keeps(text)) keys.fault(key, expected);
  return text;
}

std::vector<Provenance::Data> readData(const MapReader& calibration, FaultList& faults) {
  std::vector<Provenance::Data> data;
  const std::vector<Value::Entry>* entries = calibration.list("data");
  if (entries == nullptr) return data;
  for (std::size_t i = 0; i < entries->size(); ++i) {
    const MapReader keys((*entries)[i].value, indexPath(calibration.path("data"), i),
                         {"file", "sha256", "captures"}, faults);
    const std::string file = keys.text("file", "the path of a data set").value_or("");
    const std::string hash = formedText(keys, "sha256", "64 hexadecimal digits", isHash);
    const auto captures = keys.integer("captures", 0, std::numeric_limits<int>::max());
    data.push_back({file, hash, static_cast<int>(captures.value_or(0))});
  }
  return data;
}

std::vector<Provenance::Parameter> readParameters(const MapReader& calibration, FaultList& faults) {
  std::vector<Provenance::Parameter> parameters;
  const std::string expected = "a map of named parameters";
  const Value* given = calibration.required("parameters", expected);
  if (given == nullptr) return parameters;
  if (given->kind != Value::Kind::kMap) {
    calibration.fault("parameters", expected);
    return parameters;
  }
  for (const auto& [name, entry] : given->entries) {
    const MapReader keys(entry, joinPath(calibration.path("parameters"), name),
                         {"value", "standard_error", "identifiable", "unit"}, faults);
    const auto number = keys.number("value", kFinite);
    const auto error = keys.number("standard_error", kNotNegative);
    keys.required("identifiable", "true or false");
    const bool identifiable = keys.truth("identifiable", false);
    const std::string unit = keys.has("unit") ? keys.text("unit", "a unit").value_or("") : "";
    parameters.push_back({name, number.value_or(0), error.value_or(0), identifiable, unit});
  }
  return parameters;
}

}  // namespace

std::optional<Provenance> readProvenance(const MapReader& scene, const Value& document,
                                         FaultList& faults) {
  const Value* value = document.find("calibration");
  if (value == nullptr) return std::nullopt;
  const MapReader keys(*value, scene.path("calibration"),
                       {"date", "package_version", "from", "from_sha256", "overrides", "data",
                        "parameters", "rms", "held_out_error", "error_unit"},
                       faults);
  Provenance provenance;
  provenance.date =
      formedText(keys, "date", "a time in UTC such as 2026-01-31T12:00:00Z", isUtcTime);
  provenance.package_version =
      keys.text("package_version", "the version of the package").value_or("");
  provenance.from = keys.text("from", "the path of the scene before the calibration").value_or("");
  if (keys.has("from_sha256")) {
    provenance.from_sha256 = formedText(keys, "from_sha256", "64 hexadecimal digits", isHash);
  }
  if (keys.has("overrides")) {
    provenance.overrides = keys.text("overrides", "the keys that were overridden").value_or("");
  }
  provenance.data = readData(keys, faults);
  provenance.parameters = readParameters(keys, faults);
  provenance.rms = keys.number("rms", kNotNegative).value_or(0);
  provenance.held_out_error = keys.optionalNumber("held_out_error", kNotNegative);
  provenance.error_unit = keys.choice("error_unit", {"rad", "px", "m"}).value_or("");
  return provenance;
}

Value writeProvenance(const Provenance& provenance) {
  MapWriter out;
  out.text("date", provenance.date);
  out.text("package_version", provenance.package_version);
  out.text("from", provenance.from);
  if (!provenance.from_sha256.empty()) out.text("from_sha256", provenance.from_sha256);
  if (!provenance.overrides.empty()) out.text("overrides", provenance.overrides);
  std::vector<Value> data;
  for (const Provenance::Data& entry : provenance.data) {
    MapWriter item;
    item.text("file", entry.file);
    item.text("sha256", entry.sha256);
    item.number("captures", entry.captures);
    data.push_back(item.value());
  }
  out.list("data", data);
  MapWriter parameters;
  for (const Provenance::Parameter& parameter : provenance.parameters) {
    MapWriter item;
    item.number("value", parameter.value);
    item.number("standard_error", parameter.standard_error);
    item.word("identifiable", parameter.identifiable ? "true" : "false");
    if (!parameter.unit.empty()) item.text("unit", parameter.unit);
    parameters.set(parameter.name, item.value());
  }
  out.set("parameters", parameters.value());
  out.number("rms", provenance.rms);
  if (provenance.held_out_error) out.number("held_out_error", *provenance.held_out_error);
  out.word("error_unit", provenance.error_unit);
  return out.value();
}

}  // namespace helix_arm::io
