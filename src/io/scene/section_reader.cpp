#include "section_reader.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>

#include "helix_arm/basics/pi.hpp"
#include "helix_arm/io/number.hpp"
#include "io/document/map_reader.hpp"

namespace helix_arm::io {
namespace {

const NumberRule kResponseTime = within(kNotNegative, 0, 60, " s");
const NumberRule kPlayReach = within(kPositive, 1e-3, 1e4, " kPa");
const NumberRule kPlayWeight = within(kNotNegative, 0, model::Response::kMostWeight);

// Adds the plays of two lists; none if one of them has faults.
void readPlays(const MapReader& keys, model::Response& response) {
  const auto reach = keys.numbers("play_kpa", 0, kPlayReach);
  if (!reach) return;
  if (reach->empty()) {
    keys.complain("play_kpa",
                  "is empty; expected 1 to 4 numbers, or leave out play_kpa and "
                  "play_weight for none");
    return;
  }
  if (reach->size() > model::kMaxPlays) {
    keys.complain("play_kpa", "has " + std::to_string(reach->size()) +
                                  " entries; expected at most " + std::to_string(model::kMaxPlays));
    return;
  }
  for (std::size_t j = 1; j < reach->size(); ++j) {
    if ((*reach)[j] > (*reach)[j - 1]) continue;
    keys.complain("play_kpa", "has " + formatNumber((*reach)[j]) + " after " +
                                  formatNumber((*reach)[j - 1]) + "; expected ascending values");
    return;
  }
  const auto weight = keys.numbers("play_weight", reach->size(), kPlayWeight);
  if (!weight) return;
  double sum = 0.0;
  for (std::size_t j = 0; j < reach->size(); ++j) {
    response.plays[j] = {pascals((*reach)[j]), (*weight)[j]};
    sum += (*weight)[j];
  }
  try {
    response.play_count = static_cast<int>(reach->size());
    response.validate();
  } catch (const std::invalid_argument&) {
    response.play_count = 0;
    keys.complain("play_weight", "has the sum " + formatNumber(sum) + "; expected at most " +
                                     formatNumber(model::Response::kMostWeight) +
                                     ", so that every length belongs to one pressure");
  }
}

}  // namespace

model::Response readResponse(const Value& value, const std::string& path, FaultList& faults) {
  const MapReader keys(value, path,
                       {"rise_time_constant_s", "fall_time_constant_s", "play_kpa", "play_weight"},
                       faults);
  model::Response response;
  response.rise_time = keys.number("rise_time_constant_s", kResponseTime, 0.0);
  response.fall_time = keys.number("fall_time_constant_s", kResponseTime, response.rise_time);
  if (keys.has("play_kpa")) {
    readPlays(keys, response);
  } else if (keys.has("play_weight")) {
    keys.complain("play_weight", "is given without play_kpa; expected both or none");
  }
  return response;
}

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

namespace {

Eigen::Matrix3d rotation(double angle, const Eigen::Vector3d& axis) {
  return Eigen::AngleAxisd(angle, axis).toRotationMatrix();
}

// Rotation of a muscle at the angle th of the cross-section: z axis outwards, tangent tilted.
Eigen::Matrix3d muscleRotation(double th, double tilt) {
  return rotation(th - basics::kPi / 2, Eigen::Vector3d::UnitX()) *
         rotation(-tilt, Eigen::Vector3d::UnitZ());
}

const NumberRule kLengthScale = within(kPositive, 0.5, 2);
const NumberRule kExtensionalStiffness = within(kPositive, 1e-3, 1e9, " N");

const NumberRule kTilt{"an angle above -90 and below 90",
                       [](double x) { return std::abs(x) < 90; }};

const NumberRule kPhase = within(kFinite, -360, 360, " degrees");
const NumberRule kPlate = within(kNotNegative, 0, 10, " m");

// Keys of an actuator except its pose.
struct Fitting {
  const NamedContraction* contraction = nullptr;
  std::optional<model::Range> limits;
};

std::optional<model::Range> readLimits(const MapReader& keys, const std::string& contraction_name,
                                       const NamedContraction& contraction) {
  const model::Range& range = contraction.curve.inputRange();
  model::Range limits = range;
  bool sound = true;
  for (const auto& [key, limit] : {std::pair{"min_pressure_kpa", &limits.lower},
                                   std::pair{"max_pressure_kpa", &limits.upper}}) {
    if (!keys.has(key)) continue;
    if (!model::isPressure(contraction.drive)) {
      keys.complain(key, "limits a pressure, but contraction " + contraction_name +
                             " is a tendon; expected its max_angle_rad to be the limit");
      sound = false;
      continue;
    }
    const std::optional<double> kpa = keys.number(key, kPressure);
    if (kpa && !range.contains(pascals(*kpa))) {
      keys.fault(key, "a pressure that contraction " + contraction_name + " covers, " +
                          formatNumber(range.lower / 1e3) + " to " +
                          formatNumber(range.upper / 1e3));
    }
    sound = sound && kpa && range.contains(pascals(*kpa));
    if (kpa) *limit = pascals(*kpa);
  }
  if (sound && !(limits.lower < limits.upper)) {
    const std::string key = keys.has("min_pressure_kpa") ? "min_pressure_kpa" : "max_pressure_kpa";
    keys.fault(key, "a minimum below the maximum");
    sound = false;
  }
  return sound ? std::optional(limits) : std::nullopt;
}

Fitting readFitting(const MapReader& keys, const ArmContext& arm) {
  const std::optional<std::string> name = keys.word("contraction");
  if (!name) return {};
  const auto found = arm.contractions.find(*name);
  if (found == arm.contractions.end()) {
    std::vector<std::string> known;
    for (const auto& entry : arm.contractions) known.push_back(entry.first);
    keys.fault("contraction", known.empty() ? "the name of a curve in contractions"
                                            : "one of contractions: " + alternatives(known));
    return {};
  }
  if (!found->second) return {};
  return {&*found->second, readLimits(keys, *name, *found->second)};
}

// Length scales of a ring: one factor, or one per actuator. Invalid ones are reported and read as
// 1.
std::vector<double> readLengthScales(const MapReader& ring, const Value& value, std::size_t count) {
  const std::string key = "length_scale";
  const Value* given = value.find(key);
  if (given == nullptr || given->kind != Value::Kind::kList) {
    return std::vector<double>(count, ring.number(key, kLengthScale, 1.0));
  }
  return ring.numbers(key, count, kLengthScale).value_or(std::vector<double>(count, 1.0));
}

// Appends an actuator, with one pose or, along a tapered section, several. Incomplete ones count,
// so that default names keep their numbers.
void addActuator(const std::optional<std::string>& name, const std::vector<lie::SE3>& along,
                 const InheritedStiffness& stiffness, const Fitting& fitting, double length_scale,
                 model::Section& section) {
  if (!name || !stiffness.value || fitting.contraction == nullptr || !fitting.limits) return;
  section.actuators.push_back({*name, along.front(), *stiffness.value,
                               fitting.contraction->curve.scaledBy(length_scale), *fitting.limits,
                               fitting.contraction->drive, fitting.contraction->response});
  if (along.size() > 1) section.actuators.back().taper = along;
}

// Default name: actuators are numbered from the base on.
std::string nextName(ArmContext& arm) { return "muscle_" + std::to_string(++arm.actuator_count); }

void claimName(const MapReader& keys, const std::optional<std::string>& name, ArmContext& arm) {
  if (!name || arm.actuator_names.insert(*name).second) return;
  keys.complain(keys.has("name") ? "name" : "",
                "makes a second actuator named " + *name + "; expected distinct names");
}

// A number, or a list of 2 or more from the section's beginning to its end.
std::optional<std::vector<double>> readAlong(const MapReader& ring, const Value& value,
                                             const std::string& key, const NumberRule& rule,
                                             const std::optional<double>& fallback) {
  const Value* given = value.find(key);
  if (given != nullptr && given->kind == Value::Kind::kList) {
    auto numbers = ring.numbers(key, 0, rule);
    if (numbers && (numbers->size() < 2 || numbers->size() > model::kMostCells + 1)) {
      ring.complain(key, "has " + std::to_string(numbers->size()) +
                             " entries; expected one number, or a list of 2 to " +
                             std::to_string(model::kMostCells + 1));
      return std::nullopt;
    }
    return numbers;
  }
  if (given == nullptr && fallback) return std::vector<double>{*fallback};
  const std::optional<double> number = ring.number(key, rule);
  return number ? std::optional(std::vector<double>{*number}) : std::nullopt;
}

bool isZero(const std::vector<double>& values) {
  return std::all_of(values.begin(), values.end(), [](double value) { return value == 0; });
}

void readRing(const Value& value, const std::string& path, const InheritedStiffness& stiffness,
              ArmContext& arm, model::Section& section) {
  const MapReader ring(value, path,
                       {"count", "radius_m", "phase_deg", "tilt_deg", "contraction", "length_scale",
                        "min_pressure_kpa", "max_pressure_kpa"},
                       arm.faults);
  const auto count = ring.integer("count", 1, model::kMaxActuators);
  const auto radius = readAlong(ring, value, "radius_m", kLength, std::nullopt);
  const auto tilt_deg = readAlong(ring, value, "tilt_deg", kTilt, 0.0);
  const double phase_deg = ring.number("phase_deg", kPhase, 0.0);
  const Fitting fitting = readFitting(ring, arm);
  if (arm.planar && phase_deg != 0 && std::abs(phase_deg) != 180) {
    ring.fault("phase_deg", "0 or 180: the muscles of a planar arm are in its x-y plane");
  }
  if (arm.planar && count && *count != 2) {
    ring.fault("count", "2, the number of muscles in the ring of a planar arm");
  }
  if (arm.planar && tilt_deg && !isZero(*tilt_deg)) {
    ring.fault("tilt_deg", "0: a planar arm has no tilt");
  }
  if (!count || !radius || !tilt_deg) return;
  const std::size_t places = std::max(radius->size(), tilt_deg->size());
  if (std::min(radius->size(), tilt_deg->size()) > 1 && radius->size() != tilt_deg->size()) {
    ring.complain("tilt_deg", "has " + std::to_string(tilt_deg->size()) + " values; expected " +
                                  std::to_string(radius->size()) +
                                  ", as many as radius_m, or one number");
    return;
  }
  const std::vector<double> scales =
      readLengthScales(ring, value, static_cast<std::size_t>(*count));
  for (int i = 0; i < *count; ++i) {
    const double th = radians(phase_deg) + 2 * basics::kPi * i / static_cast<double>(*count);
    std::vector<lie::SE3> along;
    for (std::size_t place = 0; place < places; ++place) {
      const double r = (*radius)[radius->size() > 1 ? place : 0];
      const double tilt = (*tilt_deg)[tilt_deg->size() > 1 ? place : 0];
      lie::SE3 X_O{muscleRotation(th, radians(tilt)),
                   r * Eigen::Vector3d(0, std::cos(th), std::sin(th))};
      // In the plane, an untilted muscle is not rotated about its own axis, which also avoids the
      // rounding error of sin(pi).
      if (arm.planar) X_O = {Eigen::Matrix3d::Identity(), {0, X_O.translation.y(), 0}};
      along.push_back(X_O);
    }
    const std::string name = nextName(arm);
    claimName(ring, name, arm);
    addActuator(name, along, stiffness, fitting, scales[static_cast<std::size_t>(i)], section);
  }
}

std::optional<lie::SE3> readActuatorPose(const MapReader& keys, bool planar) {
  const bool tilted = keys.has("tilt_deg"), turned = keys.has("rpy_deg");
  const auto p = vector3(keys.numbers("position_m", 3, kCoordinate));
  const auto rpy_deg = turned ? vector3(keys.numbers("rpy_deg", 3, kFinite))
                              : std::optional<Eigen::Vector3d>(Eigen::Vector3d::Zero());
  const double tilt_deg = keys.number("tilt_deg", kTilt, 0.0);
  if (tilted && turned) keys.fault("tilt_deg", "either tilt_deg or rpy_deg");
  if (p && p->x() != 0) {
    keys.complain("position_m",
                  "has x = " + formatNumber(p->x()) + "; expected 0, the cross-section");
  }
  if (planar && p && p->z() != 0) {
    keys.complain("position_m",
                  "has z = " + formatNumber(p->z()) + "; expected 0, the arm's plane");
  }
  if (planar && rpy_deg && !rpy_deg->head<2>().isZero(0)) {
    keys.complain("rpy_deg", "leaves the plane; expected roll and pitch 0 in a planar arm");
  }
  if (planar && tilt_deg != 0) keys.fault("tilt_deg", "0: a planar arm has no tilt");
  if (p && p->isZero(0) && tilt_deg != 0) {
    keys.fault("tilt_deg", "0 at the centre, which has no outward side to tilt about");
  }
  if (!p || !rpy_deg) return std::nullopt;
  if (!tilted || planar) return lie::SE3{rotationOfRpyDeg(*rpy_deg), *p};
  return lie::SE3{muscleRotation(std::atan2(p->z(), p->y()), radians(tilt_deg)), *p};
}

void readActuator(const Value& value, const std::string& path, const InheritedStiffness& inherited,
                  ArmContext& arm, model::Section& section) {
  const MapReader keys(value, path,
                       {"name", "position_m", "rpy_deg", "tilt_deg", "contraction", "length_scale",
                        "stiffness", "min_pressure_kpa", "max_pressure_kpa"},
                       arm.faults);
  const std::string numbered = nextName(arm);
  const auto name = keys.has("name") ? keys.word("name") : std::optional(numbered);
  claimName(keys, name, arm);
  const auto X_O = readActuatorPose(keys, arm.planar);
  const InheritedStiffness stiffness = readStiffness(keys, value, inherited, arm.faults);
  const Value* own = value.find("stiffness");
  if (const Value* K_eps = own == nullptr ? nullptr : own->find("K_eps_n")) {
    report(arm.faults, K_eps->place,
           keys.path("stiffness.K_eps_n") +
               " is that of one actuator; expected it in the stiffness of the section or of arm: K "
               "of a "
               "section is relative to one K_eps");
  }
  const Fitting fitting = readFitting(keys, arm);
  if (!stiffness.given) keys.fault("stiffness", "it here, in the section or in arm");
  const double length_scale = keys.number("length_scale", kLengthScale, 1.0);
  if (X_O) addActuator(name, {*X_O}, stiffness, fitting, length_scale, section);
}

// K_eps against pressure. Invalid ones are reported and leave none.
void readStiffnessTable(const MapReader& keys, InheritedStiffness& stiffness) {
  stiffness.K_eps.reset();
  const auto pressure = keys.numbers("pressure_kpa", 0, kPressure);
  const auto force = keys.numbers("force_n", 0, kExtensionalStiffness);
  if (!pressure || !force) return;
  if (pressure->size() < 2 || pressure->size() != force->size()) {
    keys.complain("force_n", "has " + std::to_string(force->size()) + " entries for " +
                                 std::to_string(pressure->size()) +
                                 " of pressure_kpa; expected 2 or more of each");
    return;
  }
  for (std::size_t i = 1; i < pressure->size(); ++i) {
    if ((*pressure)[i] > (*pressure)[i - 1]) continue;
    keys.complain("pressure_kpa", "has " + formatNumber((*pressure)[i]) + " after " +
                                      formatNumber((*pressure)[i - 1]) +
                                      "; expected ascending pressures");
    return;
  }
  const double least = *std::min_element(force->begin(), force->end());
  stiffness.K_eps = least;
  // A constant table is a number.
  if (*std::max_element(force->begin(), force->end()) == least) return;
  for (std::size_t i = 0; i < force->size(); ++i) {
    stiffness.table.input.push_back(pascals((*pressure)[i]));
    stiffness.table.factor.push_back((*force)[i] / least);
  }
}

// The table must cover what its actuators can be asked for.
void checkTable(const MapReader& keys, const SectionParts& parts) {
  for (const model::Actuator& actuator : parts.section.actuators) {
    if (parts.table.empty()) return;
    const std::string who = "gives " + actuator.name + " a K_eps_n that depends on pressure";
    if (!model::isPressure(actuator.drive)) {
      keys.complain("", who + ", but it is a tendon; expected one number");
    } else if (actuator.limits.lower < parts.table.input.front() ||
               actuator.limits.upper > parts.table.input.back()) {
      keys.complain("", who + ", from " + formatNumber(parts.table.input.front() / 1e3) + " to " +
                            formatNumber(parts.table.input.back() / 1e3) +
                            " kPa; expected to cover its limits of " +
                            formatNumber(actuator.limits.lower / 1e3) + " to " +
                            formatNumber(actuator.limits.upper / 1e3) + " kPa");
    } else {
      continue;
    }
    return;
  }
}

}  // namespace

InheritedStiffness readStiffness(const MapReader& owner, const Value& value,
                                 const InheritedStiffness& inherited, FaultList& faults) {
  const Value* own = value.find("stiffness");
  if (own == nullptr) return inherited;
  const MapReader keys(*own, owner.path("stiffness"),
                       {"K_gamma", "K_tau_m2", "K_kappa_m2", "K_eps_n"}, faults);
  const auto gamma = keys.number("K_gamma", kStiffness);
  const auto tau = keys.number("K_tau_m2", kStiffness);
  const auto kappa = keys.number("K_kappa_m2", kStiffness);
  InheritedStiffness stiffness{true, std::nullopt, inherited.K_eps_given, inherited.K_eps,
                               inherited.table};
  if (gamma && tau && kappa) stiffness.value = model::Stiffness{*gamma, *tau, *kappa};
  if (keys.has("K_eps_n")) {
    stiffness.K_eps_given = true;
    stiffness.table = {};
    const Value& K_eps = *own->find("K_eps_n");
    if (K_eps.kind == Value::Kind::kMap) {
      readStiffnessTable(
          MapReader(K_eps, keys.path("K_eps_n"), {"pressure_kpa", "force_n"}, faults), stiffness);
    } else {
      stiffness.K_eps = keys.number("K_eps_n", kExtensionalStiffness);
    }
  }
  return stiffness;
}

SectionParts readSection(const Value& value, const std::string& path, ArmContext& arm) {
  SectionParts parts;
  const MapReader keys(value, path,
                       {"name", "stiffness", "ring", "actuators", "plate_m", "separators",
                        "separator_radius_m", "muscle_radius_m"},
                       arm.faults);
  const auto name = keys.word("name");
  if (name && !arm.section_names.insert(*name).second) {
    keys.fault("name", "a name that no other section has");
  }
  SectionLook& look = parts.look;
  look.name = name.value_or("");
  look.separators = static_cast<int>(keys.integer("separators", 2, 1000, look.separators));
  look.separator_radius = keys.number("separator_radius_m", kLength, look.separator_radius);
  look.muscle_radius = keys.number("muscle_radius_m", kLength, look.muscle_radius);

  parts.section.plate = keys.number("plate_m", kPlate, 0.0);
  const InheritedStiffness stiffness = readStiffness(keys, value, arm.stiffness, arm.faults);
  parts.K_eps_given = stiffness.K_eps_given;
  parts.K_eps = stiffness.K_eps;
  parts.table = stiffness.table;
  const auto layout = keys.exactlyOne({"ring", "actuators"});
  if (layout == "ring") {
    if (!stiffness.given) keys.fault("stiffness", "it here or in arm");
    readRing(*value.find("ring"), keys.path("ring"), stiffness, arm, parts.section);
  } else if (layout == "actuators") {
    const std::vector<Value::Entry>* actuators = keys.list("actuators");
    if (actuators == nullptr) return parts;
    if (actuators->size() > model::kMaxActuators) {
      keys.complain("actuators", "has " + std::to_string(actuators->size()) +
                                     " entries; expected at most " +
                                     std::to_string(model::kMaxActuators));
    }
    for (std::size_t i = 0; i < actuators->size(); ++i) {
      readActuator((*actuators)[i].value, indexPath(keys.path("actuators"), i), stiffness, arm,
                   parts.section);
    }
  }
  checkTable(keys, parts);
  return parts;
}

}  // namespace helix_arm::io
