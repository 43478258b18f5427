#include "provenance_section.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <limits>
#include <map>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/io/number.hpp"
#include "io/document/document.hpp"

namespace helix_arm::io {
namespace {

constexpr std::size_t kHashDigits = 64;
// Largest difference of the products of exponents from those of orthogonal unit vectors.
constexpr double kSkew = 1e-3;

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

// The powers of one combination; empty after a fault.
std::map<std::string, double> readExponents(const MapReader& combination,
                                            const std::vector<Provenance::Parameter>& parameters,
                                            FaultList& faults) {
  const std::string expected = "a map of at least two of the parameters";
  const Value* given = combination.required("exponents", expected);
  if (given == nullptr) return {};
  if (given->kind != Value::Kind::kMap || given->entries.size() < 2) {
    combination.fault("exponents", expected);
    return {};
  }
  std::vector<std::string> names;
  for (const Value::Entry& entry : given->entries) names.push_back(entry.key);
  const MapReader keys(*given, combination.path("exponents"), names, faults);
  std::map<std::string, double> out;
  for (const std::string& name : names) {
    const bool known = std::any_of(parameters.begin(), parameters.end(),
                                   [&name](const auto& one) { return one.name == name; });
    if (!known) keys.complain(name, "is not one of calibration.parameters");
    const auto exponent = keys.number(name, kFinite);
    if (!exponent) return {};
    out[name] = *exponent;
  }
  return out;
}

bool areOrthonormal(const std::vector<Provenance::Combination>& combinations) {
  std::map<std::string, Eigen::Index> columns;
  for (const Provenance::Combination& one : combinations) {
    for (const auto& [name, exponent] : one.exponents) {
      columns.emplace(name, static_cast<Eigen::Index>(columns.size()));
    }
  }
  const auto count = static_cast<Eigen::Index>(combinations.size());
  if (static_cast<Eigen::Index>(columns.size()) != count) return false;
  Eigen::MatrixXd U = Eigen::MatrixXd::Zero(count, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    for (const auto& [name, exponent] : combinations[static_cast<std::size_t>(i)].exponents) {
      U(i, columns.at(name)) = exponent;
    }
  }
  return (U * U.transpose()).isIdentity(kSkew);
}

std::vector<Provenance::Combination> readCombinations(
    const MapReader& calibration, const std::vector<Provenance::Parameter>& parameters,
    FaultList& faults) {
  std::vector<Provenance::Combination> out;
  if (!calibration.has("combinations")) return out;
  const std::vector<Value::Entry>* entries = calibration.list("combinations");
  if (entries == nullptr) return out;
  for (std::size_t i = 0; i < entries->size(); ++i) {
    const MapReader keys((*entries)[i].value, indexPath(calibration.path("combinations"), i),
                         {"exponents", "relative_error", "identifiable"}, faults);
    auto exponents = readExponents(keys, parameters, faults);
    const auto error = keys.number("relative_error", kPositive);
    keys.required("identifiable", "true or false");
    out.push_back({std::move(exponents), error.value_or(1), keys.truth("identifiable", false)});
  }
  const bool read =
      std::none_of(out.begin(), out.end(), [](const auto& one) { return one.exponents.empty(); });
  if (read && !areOrthonormal(out)) {
    calibration.complain("combinations",
                         "are not as many as their parameters, with exponents that are orthogonal "
                         "unit vectors; expected those that the calibration wrote");
  }
  return out;
}

}  // namespace

std::optional<Provenance> readProvenance(const MapReader& scene, const Value& document,
                                         FaultList& faults) {
  const Value* value = document.find("calibration");
  if (value == nullptr) return std::nullopt;
  const MapReader keys(*value, scene.path("calibration"),
                       {"date", "package_version", "from", "from_sha256", "overrides", "data",
                        "parameters", "combinations", "rms", "held_out_error", "error_unit"},
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
  provenance.combinations = readCombinations(keys, provenance.parameters, faults);
  provenance.rms = keys.number("rms", kNotNegative).value_or(0);
  provenance.held_out_error = keys.optionalNumber("held_out_error", kNotNegative);
  provenance.error_unit = keys.choice("error_unit", {"rad", "px", "m"}).value_or("");
  return provenance;
}

Value writeProvenance(const Provenance& provenance) {
  MapWriter out;
  out.text("date", provenance.date);
  out.text("package_version", provenance.package_version);
  out.text("from", basics::printable(provenance.from));
  if (!provenance.from_sha256.empty()) out.text("from_sha256", provenance.from_sha256);
  if (!provenance.overrides.empty()) out.text("overrides", basics::printable(provenance.overrides));
  std::vector<Value> data;
  for (const Provenance::Data& entry : provenance.data) {
    MapWriter item;
    item.text("file", basics::printable(entry.file));
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
  std::vector<Value> combinations;
  for (const Provenance::Combination& combination : provenance.combinations) {
    MapWriter exponents;
    for (const auto& [name, exponent] : combination.exponents) exponents.number(name, exponent);
    MapWriter item;
    item.set("exponents", exponents.value());
    item.number("relative_error", combination.relative_error);
    item.word("identifiable", combination.identifiable ? "true" : "false");
    combinations.push_back(item.value());
  }
  if (!combinations.empty()) out.list("combinations", combinations);
  out.number("rms", provenance.rms);
  if (provenance.held_out_error) out.number("held_out_error", *provenance.held_out_error);
  out.word("error_unit", provenance.error_unit);
  return out.value();
}

}  // namespace helix_arm::io
