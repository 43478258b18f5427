#include "contraction_reader.hpp"

#include <algorithm>
#include <array>
#include <stdexcept>

#include "helix_arm/io/number.hpp"
#include "response_reader.hpp"

namespace helix_arm::io {
namespace {

using OptionalCurve = std::optional<model::Contraction>;

OptionalCurve readQuintic(const MapReader& quintic) {
  const auto coefficients = quintic.numbers("coefficients_m", 6, kFinite);
  const auto reference = quintic.number("reference_pressure_kpa", kPositivePressure);
  const auto max = quintic.number("max_pressure_kpa", kPositivePressure);
  if (!coefficients || !reference || !max) return std::nullopt;
  std::array<double, 6> c{};
  std::copy(coefficients->begin(), coefficients->end(), c.begin());
  return model::Contraction::quintic(c, pascals(*reference), pascals(*max));
}

OptionalCurve readTable(const MapReader& table) {
  auto pressure = table.numbers("pressure_kpa", 0, kPressure);
  const auto length = table.numbers("length_m", 0, kLength);
  if (!pressure || !length) return std::nullopt;
  std::transform(pressure->begin(), pressure->end(), pressure->begin(), &pascals);
  return model::Contraction::table(*pressure, *length);
}

OptionalCurve readTendon(const MapReader& tendon) {
  const auto length = tendon.number("length_m", kLength);
  const auto radius = tendon.number("spool_radius_m", kLength);
  const auto max_angle = tendon.number("max_angle_rad", kPositive);
  if (!length || !radius || !max_angle) return std::nullopt;
  return model::Contraction::tendon(*length, *radius, *max_angle);
}

struct CurveKind {
  std::string key;
  std::vector<std::string> known;
  OptionalCurve (*read)(const MapReader&);
  model::Drive drive;
};

const std::vector<CurveKind>& curveKinds() {
  using model::Drive;
  static const std::vector<CurveKind> kinds{
      {"quintic",
       {"coefficients_m", "reference_pressure_kpa", "max_pressure_kpa"},
       readQuintic,
       Drive::kPressure},
      {"table", {"pressure_kpa", "length_m"}, readTable, Drive::kPressure},
      {"tendon", {"length_m", "spool_radius_m", "max_angle_rad"}, readTendon, Drive::kTendon},
  };
  return kinds;
}

// None without the key.
model::Response responseOf(const MapReader& contraction, const Value& value, model::Drive drive,
                           FaultList& faults) {
  const Value* given = value.find(kResponseKey);
  if (given == nullptr) return {};
  if (!model::isPressure(drive)) {
    contraction.complain(kResponseKey,
                         "is given for a tendon, which follows its spool; expected it "
                         "only where the input is a pressure");
  }
  return readResponse(*given, contraction.path(kResponseKey), faults);
}

std::optional<NamedContraction> readContraction(const Value& value, const std::string& path,
                                                FaultList& faults) {
  std::vector<std::string> keys;
  for (const CurveKind& kind : curveKinds()) keys.push_back(kind.key);
  std::vector<std::string> known = keys;
  known.emplace_back(kResponseKey);
  const MapReader contraction(value, path, known, faults);
  const std::optional<std::string> given = contraction.exactlyOne(keys);
  if (!given) return std::nullopt;
  for (const CurveKind& kind : curveKinds()) {
    if (kind.key != *given) continue;
    const model::Response response = responseOf(contraction, value, kind.drive, faults);
    const MapReader curve(*value.find(*given), joinPath(path, *given), kind.known, faults);
    try {
      OptionalCurve read = kind.read(curve);
      if (read) return NamedContraction{std::move(*read), kind.drive, response};
    } catch (const std::invalid_argument& error) {
      contraction.complain(
          *given,
          std::string("is not a valid contraction (values in Pa, m and rad): ") + error.what());
    }
  }
  return std::nullopt;
}

}  // namespace

Contractions readContractions(const MapReader& scene, FaultList& faults) {
  Contractions contractions;
  const std::string key = "contractions";
  const Value* curves = scene.required(key, "a map of named contraction curves");
  if (curves == nullptr) return contractions;
  if (curves->kind != Value::Kind::kMap) {
    scene.fault(key, "a map of named contraction curves");
    return contractions;
  }
  for (const auto& [name, value] : curves->entries) {
    contractions[name] = readContraction(value, scene.path(joinPath(key, name)), faults);
  }
  return contractions;
}

}  // namespace helix_arm::io
