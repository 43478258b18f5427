#include <Eigen/Core>
#include <algorithm>
#include <limits>
#include <regex>

#include "scene_readers.hpp"

namespace helix_arm::io {
namespace {

// Largest difference of the products of exponents from those of orthogonal unit vectors.
constexpr double kSkew = 1e-3;

// A UTC time in ISO 8601; the number of days of the month is not checked.
bool isUtcTime(const std::string& text) {
  static const std::regex form("\\d{4}-\\d\\d-\\d\\dT\\d\\d:\\d\\d:\\d\\dZ");
  return std::regex_match(text, form);
}

bool isHash(const std::string& text) {
  static const std::regex form("[0-9a-f]{64}");
  return std::regex_match(text, form);
}

constexpr Text kHash{"64 hexadecimal digits", isHash};
constexpr Text kTime{"a time in UTC such as 2026-01-31T12:00:00Z", isUtcTime};

// The row of a list of maps. `keysOf` gives the rows of an entry.
template <class Entry, class KeysOf>
Key listOf(const char* name, std::vector<Entry>& list, KeysOf keysOf) {
  return {name,
          [=, &list](const MapReader& keys, const std::string& key) {
            keys.eachOf(key, [&](const Value& value, const std::string& path) {
              Entry entry{};
              MapReader(value, path, keysOf(entry), keys.faults());
              list.push_back(std::move(entry));
            });
          },
          [=, &list](Value& map, const std::string& key) {
            std::vector<Value> values;
            for (Entry& entry : list) values.push_back(mapOf(keysOf(entry)));
            if (!values.empty()) setValue(map, key, listValue(values));
          }};
}

std::vector<Key> dataKeys(Provenance::Data& data) {
  return {Key("file", Text{"the path of a data set"}, data.file).required(),
          Key("sha256", kHash, data.sha256).required(),
          Key("captures", Whole{0, std::numeric_limits<int>::max()}, data.captures).required()};
}

std::vector<Key> parameterKeys(Provenance::Parameter& parameter) {
  return {Key("value", kFinite, parameter.value).required(),
          Key("standard_error", kNotNegative, parameter.standard_error).required(),
          Key("identifiable", parameter.identifiable).required(),
          {"unit", Text{"a unit"}, parameter.unit}};
}

void readParameters(const MapReader& calibration, const std::string& key,
                    std::vector<Provenance::Parameter>& parameters) {
  const auto* entries = calibration.entries(key, 0, "a map of named parameters");
  if (entries == nullptr) return;
  for (const auto& [name, entry] : *entries) {
    Provenance::Parameter parameter{};
    parameter.name = name;
    MapReader(entry, joinPath(calibration.path(key), name), parameterKeys(parameter),
              calibration.faults());
    parameters.push_back(std::move(parameter));
  }
}

// The powers of one combination; empty after a fault.
std::map<std::string, double> readExponents(const MapReader& combination, const std::string& key,
                                            const std::vector<Provenance::Parameter>& parameters) {
  const auto* entries = combination.entries(key, 2, "a map of at least two of the parameters");
  if (entries == nullptr) return {};
  std::vector<std::string> names;
  for (const Value::Entry& entry : *entries) names.push_back(entry.key);
  const MapReader keys = *combination.map(key, keysOf(names));
  std::map<std::string, double> out;
  for (const std::string& name : names) {
    const bool known = std::any_of(parameters.begin(), parameters.end(),
                                   [&name](const auto& one) { return one.name == name; });
    if (!known) keys.complain(name, "is not one of calibration.parameters");
    const auto exponent = keys.read(name, kFinite);
    if (!exponent) return {};
    out[name] = *exponent;
  }
  return out;
}

std::vector<Key> combinationKeys(Provenance::Combination& combination,
                                 const std::vector<Provenance::Parameter>& parameters) {
  return {Key(
              "exponents",
              [&](const MapReader& keys, const std::string& key) {
                combination.exponents = readExponents(keys, key, parameters);
              },
              [&](Value& map, const std::string& key) {
                Value powers = mapOf({});
                for (const auto& [name, exponent] : combination.exponents) {
                  setValue(powers, name, numberValue(exponent));
                }
                setValue(map, key, std::move(powers));
              })
              .required(),
          Key("relative_error", kPositive, combination.relative_error).required(),
          Key("identifiable", combination.identifiable).required()};
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

std::vector<Key> provenanceKeys(Provenance& provenance) {
  std::vector<Provenance::Parameter>& parameters = provenance.parameters;
  return {
      Key("date", kTime, provenance.date).required(),
      Key("package_version", Text{"the version of the package"}, provenance.package_version)
          .required(),
      Key("from", Text{"the path of the scene before the calibration"}, provenance.from).required(),
      {"from_sha256", kHash, provenance.from_sha256},
      {"overrides", Text{"the keys that were overridden"}, provenance.overrides},
      listOf("data", provenance.data, dataKeys).required(),
      Key(
          "parameters",
          [&](const MapReader& keys, const std::string& key) {
            readParameters(keys, key, parameters);
          },
          [&](Value& map, const std::string& key) {
            Value named = mapOf({});
            for (Provenance::Parameter& one : parameters) {
              setValue(named, one.name, mapOf(parameterKeys(one)));
            }
            setValue(map, key, std::move(named));
          })
          .required(),
      listOf("combinations", provenance.combinations,
             [&](Provenance::Combination& one) { return combinationKeys(one, parameters); }),
      Key("rms", kNotNegative, provenance.rms).required(),
      {"held_out_error", kNotNegative, provenance.held_out_error},
      Key("error_unit", oneOf({"rad", "px", "m", "N"}), provenance.error_unit).required()};
}

}  // namespace

std::optional<Provenance> readProvenance(const MapReader& scene) {
  Provenance provenance{};
  const auto keys = scene.map("calibration", provenanceKeys(provenance));
  if (!keys) return std::nullopt;
  const std::vector<Provenance::Combination>& combinations = provenance.combinations;
  const bool read = std::none_of(combinations.begin(), combinations.end(),
                                 [](const auto& one) { return one.exponents.empty(); });
  if (!combinations.empty() && read && !areOrthonormal(combinations)) {
    keys->complain("combinations",
                   "are not as many as their parameters, with exponents that are orthogonal "
                   "unit vectors; expected those that the calibration wrote");
  }
  return provenance;
}

std::optional<Provenance::PlacementError> Provenance::errorOf(estimation::FitParameter placement,
                                                              const std::string& of) const {
  const estimation::FitParameterInfo& info = estimation::infoOf(placement);
  PlacementError out{lie::Vector6::Zero(), false};
  for (std::size_t i = 0; i < info.numbers.size(); ++i) {
    const std::string name = info.name + of + info.numbers[i].suffix;
    const auto found = std::find_if(parameters.begin(), parameters.end(),
                                    [&name](const Parameter& one) { return one.name == name; });
    if (found == parameters.end()) return std::nullopt;
    out.deviations[static_cast<Eigen::Index>(i)] = found->standard_error;
    out.seen |= found->identifiable;
  }
  return out;
}

Value writeProvenance(Provenance provenance) { return mapOf(provenanceKeys(provenance)); }

}  // namespace helix_arm::io
