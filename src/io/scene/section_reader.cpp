#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include "basics/pi.hpp"
#include "basics/text.hpp"
#include "io/document/number.hpp"
#include "scene_readers.hpp"

namespace helix_arm::io {
namespace {

constexpr NumberRule kResponseTime = within(kNotNegative, 0, 60, " s");
constexpr NumberRule kPlayReach = within(kPositive, 1e-3, 1e4, " kPa");
constexpr NumberRule kPlayWeight = within(kNotNegative, 0, model::Response::kMostWeight);
constexpr NumberRule kSlowTime = within(kPositive, 1e-2, 3600, " s");

// Whether each value exceeds the one before; the first that does not is a fault.
bool areAscending(const MapReader& keys, const std::string& key, const std::vector<double>& values,
                  const char* what) {
  for (std::size_t i = 1; i < values.size(); ++i) {
    if (values[i] > values[i - 1]) continue;
    keys.complain(key, "has ", formatNumber(values[i]), " after ", formatNumber(values[i - 1]),
                  "; expected ascending ", what);
    return false;
  }
  return true;
}

// Adds the plays of two lists; none if one of them has faults.
void readPlays(const MapReader& keys, model::Response& response) {
  const auto reach = keys.read("play_kpa", Numbers{kPlayReach});
  if (!reach) return;
  if (reach->empty()) {
    return keys.complain("play_kpa",
                         "is empty; expected 1 to 4 numbers, or leave out play_kpa and "
                         "play_weight for none");
  }
  if (reach->size() > model::kMaxPlays) {
    return keys.complainOfSize("play_kpa", reach->size(), "at most ", model::kMaxPlays);
  }
  if (!areAscending(keys, "play_kpa", *reach, "values")) return;
  const auto weight = keys.read("play_weight", Numbers{kPlayWeight, reach->size()});
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
    keys.complain("play_weight", "has the sum ", formatNumber(sum), "; expected at most ",
                  formatNumber(model::Response::kMostWeight),
                  ", so that every length belongs to one pressure");
  }
}

// Adds the slow state of two keys that are read; none if they have faults. After the plays.
void addSlowState(const MapReader& keys, double time, double weight, model::Response& response) {
  const char* const pair[] = {"slow_time_constant_s", "slow_weight"};
  for (int given : {0, 1}) {
    if (keys.has(pair[given]) && !keys.has(pair[1 - given])) {
      keys.complain(pair[given], "is given without ", pair[1 - given], "; expected both or none");
    }
  }
  if (time == 0) return;
  model::Response slow = response;
  slow.slow_time = time;
  slow.slow_weight = weight;
  try {
    slow.validate();
    response = slow;
  } catch (const std::invalid_argument&) {
    keys.complain("slow_weight", "and play_weight have the sum ", formatNumber(slow.weights()),
                  "; expected at most ", formatNumber(model::Response::kMostWeight));
  }
}

using OptionalCurve = std::optional<model::Contraction>;

OptionalCurve readQuintic(const MapReader& contraction, const std::string& key) {
  double reference = 0, most = 0;
  std::vector<double> coefficients;
  const MapReader keys = *contraction.map(
      key, {Key("coefficients_m", Numbers{kFinite, 6}, coefficients).required(),
            Key("reference_pressure_kpa", kPositivePressure, reference, kKilo).required(),
            Key("max_pressure_kpa", kPositivePressure, most, kKilo).required()});
  if (!keys.isSound()) return std::nullopt;
  std::array<double, 6> c{};
  std::copy(coefficients.begin(), coefficients.end(), c.begin());
  const model::Contraction curve = model::Contraction::quintic(c, reference, most);
  for (const double length : {curve.lengthRange().lower, curve.lengthRange().upper}) {
    if (length >= kLength.lowest && length <= kLength.highest) continue;
    keys.complain("coefficients_m", "gives a length of ", formatNumber(length), " m; expected ",
                  formatNumber(kLength.lowest), " to ", formatNumber(kLength.highest), kLength.unit,
                  unitHint(length, kLength));
    return std::nullopt;
  }
  return curve;
}

OptionalCurve readTable(const MapReader& contraction, const std::string& key) {
  std::vector<double> pressure, length;
  const MapReader keys =
      *contraction.map(key, {Key("pressure_kpa", Numbers{kPressure}, pressure, kKilo).required(),
                             Key("length_m", Numbers{kLength}, length).required()});
  if (!keys.isSound()) return std::nullopt;
  return model::Contraction::table(pressure, length);
}

OptionalCurve readTendon(const MapReader& contraction, const std::string& key) {
  double length = 0, radius = 0, max_angle = 0;
  const MapReader keys =
      *contraction.map(key, {Key("length_m", kLength, length).required(),
                             Key("spool_radius_m", kLength, radius).required(),
                             Key("max_angle_rad", kPositive, max_angle).required()});
  if (!keys.isSound()) return std::nullopt;
  return model::Contraction::tendon(length, radius, max_angle);
}

struct CurveKind {
  const char* key;
  OptionalCurve (*read)(const MapReader& contraction, const std::string& key);
  model::Drive drive;
};
constexpr CurveKind kCurveKinds[] = {{"quintic", readQuintic, model::Drive::kPressure},
                                     {"table", readTable, model::Drive::kPressure},
                                     {"tendon", readTendon, model::Drive::kTendon}};

std::optional<NamedContraction> readContraction(const Value& value, const std::string& path,
                                                FaultList& faults) {
  std::vector<std::string> kinds;
  for (const CurveKind& kind : kCurveKinds) kinds.emplace_back(kind.key);
  std::vector<Key> known = keysOf(kinds);
  known.emplace_back(kResponseKey);
  const MapReader contraction(value, path, known, faults);
  const std::optional<std::size_t> given = contraction.exactlyOne(kinds);
  if (!given) return std::nullopt;
  const CurveKind& kind = kCurveKinds[*given];
  if (contraction.has(kResponseKey) && !model::isPressure(kind.drive)) {
    contraction.complain(kResponseKey,
                         "is given for a tendon, which follows its spool; expected it "
                         "only where the input is a pressure");
  }
  const model::Response response = readResponse(contraction, kResponseKey);
  try {
    OptionalCurve curve = kind.read(contraction, kind.key);
    if (curve) return NamedContraction{std::move(*curve), kind.drive, response};
  } catch (const std::invalid_argument& error) {
    contraction.complain(kind.key,
                         "is not a valid contraction (values in Pa, m and rad): ", error.what());
  }
  return std::nullopt;
}

Eigen::Matrix3d rotation(double angle, const Eigen::Vector3d& axis) {
  return Eigen::AngleAxisd(angle, axis).toRotationMatrix();
}

// Rotation of a muscle at the angle th of the cross-section: z axis outwards, tangent tilted.
Eigen::Matrix3d muscleRotation(double th, double tilt) {
  return rotation(th - basics::kPi / 2, Eigen::Vector3d::UnitX()) *
         rotation(-tilt, Eigen::Vector3d::UnitZ());
}

constexpr NumberRule kScale = within(kPositive, 0.5, 2);
constexpr NumberRule kExtensionalStiffness = within(kPositive, 1e-3, 1e9, " N");
constexpr NumberRule kTilt{"an angle above -90 and below 90",
                           [](double x) { return x > -90 && x < 90; }};

model::Range readLimits(const MapReader& keys, const std::string& contraction_name,
                        const NamedContraction& contraction) {
  const model::Range& range = contraction.curve.inputRange();
  model::Range limits = range;
  const std::size_t before = keys.faults().count();
  for (const auto& [key, limit] : {std::pair{"min_pressure_kpa", &limits.lower},
                                   std::pair{"max_pressure_kpa", &limits.upper}}) {
    if (!keys.has(key)) continue;
    if (!model::isPressure(contraction.drive)) {
      keys.complain(key, "limits a pressure, but contraction ", contraction_name,
                    " is a tendon; expected its max_angle_rad to be the limit");
      continue;
    }
    Key(key, kPressure, *limit, kKilo).read(keys);
    if (range.contains(*limit)) continue;
    keys.fault(key, "a pressure that contraction ", contraction_name, " covers, ",
               formatNumber(range.lower / 1e3), " to ", formatNumber(range.upper / 1e3));
  }
  if (keys.faults().count() == before && !(limits.lower < limits.upper)) {
    const std::string key = keys.has("min_pressure_kpa") ? "min_pressure_kpa" : "max_pressure_kpa";
    keys.fault(key, "a minimum below the maximum");
  }
  return limits;
}

// An actuator as its keys say, except for its name and place; nothing where they name no sound
// contraction. With other faults there will be no arm.
std::optional<model::Actuator> readFitting(const MapReader& keys,
                                           const InheritedStiffness& stiffness,
                                           const ArmContext& arm) {
  const std::optional<std::string> name = keys.read("contraction", kWord);
  if (!name) return std::nullopt;
  const auto found = arm.contractions.find(*name);
  if (found == arm.contractions.end()) {
    std::vector<std::string> known;
    for (const auto& entry : arm.contractions) known.push_back(entry.first);
    keys.fault("contraction", known.empty() ? "the name of a curve in contractions"
                                            : "one of contractions: " + alternatives(known));
    return std::nullopt;
  }
  if (!found->second) return std::nullopt;
  const auto& [curve, drive, response] = *found->second;
  const model::Stiffness K = stiffness.value.value_or(model::Stiffness());
  const model::Range limits = readLimits(keys, *name, *found->second);
  return model::Actuator{{}, {}, K, curve, limits, drive, response, {}, *name};
}

// Factors on a contraction curve.
struct CurveScale {
  double length = 1, stroke = 1;
};

// Numbers of a ring: one for all its actuators, or one per actuator. Invalid ones are reported and
// read as the default.
std::vector<double> readEach(const MapReader& ring, const char* key, const NumberRule& rule,
                             double common, std::size_t count) {
  if (!ring.isList(key)) Key(key, rule, common).read(ring);
  std::vector<double> numbers(count, common);
  if (ring.isList(key)) Key(key, Numbers{rule, count}, numbers).read(ring);
  return numbers;
}

// Angles of the actuators of a ring about its axis [rad]: equally spaced from that of the first
// one, or listed.
std::vector<double> readPhases(const MapReader& ring, bool planar, std::size_t count) {
  std::vector<double> phases =
      readEach(ring, "phase_deg", within(kFinite, -360, 360, " degrees"), 0.0, count);
  const bool in_plane =
      !ring.isList("phase_deg") && (phases.front() == 0 || std::abs(phases.front()) == 180);
  if (planar && !in_plane) {
    ring.fault("phase_deg", "0 or 180: the muscles of a planar arm are in its x-y plane");
  }
  for (std::size_t i = 0; i < count; ++i) {
    phases[i] = radians(phases[i]);
    if (!ring.isList("phase_deg")) {
      phases[i] += 2 * basics::kPi * static_cast<double>(i) / static_cast<double>(count);
    }
  }
  return phases;
}

// Appends an actuator, with one pose or, along a tapered section, several.
void addActuator(const MapReader& keys, std::optional<model::Actuator> actuator,
                 const std::string& name, const std::vector<lie::SE3>& along,
                 const CurveScale& scale, model::Section& section) {
  if (!actuator) return;
  actuator->name = name;
  actuator->X_O = along.front();
  const model::Contraction& curve = actuator->contraction;
  const double rest = curve.restLength();
  const double least = rest + scale.stroke * (curve.lengthRange().lower - rest);
  if (!(least > 0)) {
    return keys.complain("stroke_scale", "makes ", name, " as short as ",
                         formatNumber(scale.length * least), " m; expected lengths > 0");
  }
  actuator->contraction = curve.scaledBy(scale.length, scale.stroke);
  if (along.size() > 1) actuator->taper = along;
  section.actuators.push_back(std::move(*actuator));
}

// Default name: actuators are numbered from the base on.
std::string nextName(ArmContext& arm) { return "muscle_" + std::to_string(++arm.actuator_count); }

void claimName(const MapReader& keys, const std::string& name, ArmContext& arm) {
  if (arm.actuator_names.insert(name).second) return;
  keys.complain(keys.has("name") ? "name" : "", "makes a second actuator named ", name,
                "; expected distinct names");
}

// A number, or a list of 2 or more from the section's beginning to its end; empty after a fault.
std::vector<double> readAlong(const MapReader& ring, const std::string& key,
                              const NumberRule& rule) {
  if (!ring.isList(key)) {
    const std::optional<double> number = ring.read(key, rule);
    return number ? std::vector<double>{*number} : std::vector<double>();
  }
  const std::optional<std::vector<double>> numbers = ring.read(key, Numbers{rule});
  if (!numbers) return {};
  if (numbers->size() >= 2 && numbers->size() <= model::kMostCells + 1) return *numbers;
  ring.complainOfSize(key, numbers->size(), "one number, or a list of 2 to ",
                      model::kMostCells + 1);
  return {};
}

void readRing(const MapReader& section, const InheritedStiffness& stiffness, ArmContext& arm,
              model::Section& out) {
  std::optional<int> count;
  const MapReader ring =
      *section.map("ring", {Key("count", Whole{1, model::kMaxActuators}, count).required(),
                            "radius_m", "phase_deg", "tilt_deg", "contraction", "length_scale",
                            "stroke_scale", "min_pressure_kpa", "max_pressure_kpa"});
  const std::vector<double> radius = readAlong(ring, "radius_m", kLength);
  const std::vector<double> tilt_deg =
      ring.has("tilt_deg") ? readAlong(ring, "tilt_deg", kTilt) : std::vector<double>{0};
  const std::optional<model::Actuator> fitting = readFitting(ring, stiffness, arm);
  if (arm.planar && count && *count != 2) {
    ring.fault("count", "2, the number of muscles in the ring of a planar arm");
  }
  const auto tilts = [](double degrees) { return degrees != 0; };
  if (arm.planar && std::any_of(tilt_deg.begin(), tilt_deg.end(), tilts)) {
    ring.fault("tilt_deg", "0: a planar arm has no tilt");
  }
  if (!count || radius.empty() || tilt_deg.empty()) return;
  const std::size_t places = std::max(radius.size(), tilt_deg.size());
  if (std::min(radius.size(), tilt_deg.size()) > 1 && radius.size() != tilt_deg.size()) {
    return ring.complain("tilt_deg", "has ", tilt_deg.size(), " values; expected ", radius.size(),
                         ", as many as radius_m, or one number");
  }
  const auto size = static_cast<std::size_t>(*count);
  const std::vector<double> lengths = readEach(ring, "length_scale", kScale, 1, size),
                            strokes = readEach(ring, "stroke_scale", kScale, 1, size),
                            phases = readPhases(ring, arm.planar, size);
  for (int i = 0; i < *count; ++i) {
    const double th = phases[static_cast<std::size_t>(i)];
    std::vector<lie::SE3> along;
    for (std::size_t place = 0; place < places; ++place) {
      const double r = radius[radius.size() > 1 ? place : 0];
      const double tilt = tilt_deg[tilt_deg.size() > 1 ? place : 0];
      lie::SE3 X_O{muscleRotation(th, radians(tilt)),
                   r * Eigen::Vector3d(0, std::cos(th), std::sin(th))};
      // In the plane, an untilted muscle is not rotated about its own axis, which also avoids the
      // rounding error of sin(pi).
      if (arm.planar) X_O = {Eigen::Matrix3d::Identity(), {0, X_O.translation.y(), 0}};
      along.push_back(X_O);
    }
    const std::string name = nextName(arm);
    claimName(ring, name, arm);
    const auto own = static_cast<std::size_t>(i);
    addActuator(ring, fitting, name, along, {lengths[own], strokes[own]}, out);
  }
}

lie::SE3 readActuatorPose(const MapReader& keys, bool planar) {
  double tilt_deg = 0;
  Eigen::Vector3d p(0, 1, 0), rpy_deg(0, 0, 0);  // kept after a fault: they cause no other
  for (const Key& key : {Key("position_m", kCoordinate, p).required(),
                         Key("rpy_deg", kFinite, rpy_deg), Key("tilt_deg", kTilt, tilt_deg)}) {
    key.read(keys);
  }
  const bool tilted = keys.has("tilt_deg");
  if (tilted && keys.has("rpy_deg")) keys.fault("tilt_deg", "either tilt_deg or rpy_deg");
  if (p.x() != 0) {
    keys.complain("position_m", "has x = ", formatNumber(p.x()), "; expected 0, the cross-section");
  }
  if (planar && p.z() != 0) {
    keys.complain("position_m", "has z = " + formatNumber(p.z()) + "; expected 0, the arm's plane");
  }
  if (planar && !rpy_deg.head<2>().isZero(0)) {
    keys.complain("rpy_deg", "leaves the plane; expected roll and pitch 0 in a planar arm");
  }
  if (planar && tilt_deg != 0) keys.fault("tilt_deg", "0: a planar arm has no tilt");
  if (p.isZero(0) && tilt_deg != 0) {
    keys.fault("tilt_deg", "0 at the centre, which has no outward side to tilt about");
  }
  if (!tilted || planar) return {rotationOfRpyDeg(rpy_deg), p};
  return {muscleRotation(std::atan2(p.z(), p.y()), radians(tilt_deg)), p};
}

void readActuator(const MapReader& keys, const InheritedStiffness& inherited, ArmContext& arm,
                  model::Section& section) {
  std::string name = nextName(arm);
  Key("name", kWord, name).read(keys);
  claimName(keys, name, arm);
  const lie::SE3 X_O = readActuatorPose(keys, arm.planar);
  const InheritedStiffness stiffness = readStiffness(keys, inherited);
  const Value* own = keys.find("stiffness");
  const bool depends = !inherited.bending.empty() || !stiffness.bending.empty();
  const auto refuse = [&keys](const char* key, const Value& given, const char* why) {
    report(keys.faults(), given.place, keys.path(key),
           " is that of one actuator; expected it in the stiffness of the section or of arm", why);
  };
  if (own != nullptr && depends) {
    refuse("stiffness.K_kappa_m2", *own, ", where it depends on pressure, and none here");
  }
  if (const Value* K_eps = own == nullptr ? nullptr : own->find("K_eps_n")) {
    refuse("stiffness.K_eps_n", *K_eps, ": K of a section is relative to one K_eps");
  }
  const std::optional<model::Actuator> fitting = readFitting(keys, stiffness, arm);
  if (!stiffness.value) keys.fault("stiffness", "it here, in the section or in arm");
  CurveScale scale;
  Key("length_scale", kScale, scale.length).read(keys);
  Key("stroke_scale", kScale, scale.stroke).read(keys);
  addActuator(keys, fitting, name, {X_O}, scale, section);
}

// A stiffness that is a number or, against pressure, a table.
using Argument = model::BendingTable::Argument;

struct StiffnessKeys {
  const char *key, *pressure, *value;
  NumberRule number, entry;
};
constexpr StiffnessKeys kEpsKeys{"K_eps_n", "pressure_kpa", "force_n", kExtensionalStiffness,
                                 kExtensionalStiffness};
// Keys of K_kappa against the pressure that an argument is.
StiffnessKeys kappaKeys(Argument argument) {
  return {"K_kappa_m2", keyOf(argument), "ratio_m2", kStiffness, within(kPositive, 0, 1e15)};
}

// @param least  its value, or the least one of the table.
void readEntry(const MapReader& owner, const StiffnessKeys& of, double& least,
               model::StiffnessTable& table) {
  const Value* const given = owner.find(of.key);
  if (given == nullptr || given->kind != Value::Kind::kMap) {
    return Key(of.key, of.number, least).required().read(owner);
  }
  const MapReader keys = *owner.map(of.key, {of.pressure, of.value});
  const auto pressure = keys.read(of.pressure, Numbers{kPressure});
  const auto value = keys.read(of.value, Numbers{of.entry});
  if (!pressure || !value) return;
  if (pressure->size() < 2 || pressure->size() != value->size()) {
    return keys.complain(of.value, "has ", value->size(), " entries for ", pressure->size(), " of ",
                         of.pressure, "; expected 2 or more of each");
  }
  if (!areAscending(keys, of.pressure, *pressure, "pressures")) return;
  least = *std::min_element(value->begin(), value->end());
  // A constant table is a number.
  if (*std::max_element(value->begin(), value->end()) == least) return;
  for (std::size_t i = 0; i < value->size(); ++i) {
    table.input.push_back(pascals((*pressure)[i]));
    table.factor.push_back((*value)[i] / least);
  }
}

void readKappa(const MapReader& owner, double& least, model::BendingTable& table) {
  const Value* const given = owner.find("K_kappa_m2");
  const bool is_map = given != nullptr && given->kind == Value::Kind::kMap;
  const bool by_others = is_map && given->find(keyOf(Argument::kOthers)) != nullptr;
  table.argument = by_others ? Argument::kOthers : Argument::kMean;
  readEntry(owner, kappaKeys(table.argument), least, table);
}

// A table must cover what its actuators can be asked for.
void checkTable(const MapReader& keys, const char* key, const model::StiffnessTable& table,
                const model::Section& section) {
  for (const model::Actuator& actuator : section.actuators) {
    if (table.empty()) return;
    const std::string who = "gives " + actuator.name + " a " + key + " that depends on pressure";
    if (!model::isPressure(actuator.drive)) {
      return keys.complain("", who + ", but it is a tendon; expected one number");
    }
    if (actuator.limits.lower < table.input.front() || actuator.limits.upper > table.input.back()) {
      return keys.complain("", who, ", from ", formatNumber(table.input.front() / 1e3), " to ",
                           formatNumber(table.input.back() / 1e3),
                           " kPa; expected to cover its limits of ",
                           formatNumber(actuator.limits.lower / 1e3), " to ",
                           formatNumber(actuator.limits.upper / 1e3), " kPa");
    }
  }
}

// Largest K_kappa, in squares of the ring's radius: pressure then bends the section by 1 % of what
// its ring allows.
constexpr double kMostBending = 100;
// Bounds of K_eps, in forces that the pressure range has on the cross-section of a muscle.
constexpr double kLeastExtensional = 0.02, kMostExtensional = 1000;

// Refuses a stiffness out of proportion to the section's ring and muscles, as in another unit.
// After other faults, a default may stand for what was given.
void checkStiffness(const MapReader& keys, const SectionParts& parts) {
  if (keys.faults().count() > 0) return;
  double radius = parts.look.muscle_radius, K_kappa = 0, force = 0;
  const double area = basics::kPi * radius * radius;
  for (const model::Actuator& actuator : parts.section.actuators) {
    radius = std::max(radius, actuator.X_O.translation.norm());
    K_kappa = std::max(K_kappa, actuator.stiffness.kappa);
    if (!model::isPressure(actuator.drive)) continue;
    force = std::max(force, (actuator.limits.upper - actuator.limits.lower) * area);
  }
  const auto figure = [](double value) { return basics::format("%.3g", value); };
  if (const double square = radius * radius; K_kappa > kMostBending * square) {
    const bool is_mm = 1e-6 * K_kappa > 0.01 * square;
    keys.complain("", "has K_kappa_m2 ", figure(K_kappa), "; expected at most ",
                  figure(kMostBending * square), " m^2, 100 times the ring's radius squared: ",
                  figure((is_mm ? 1e-6 : 1e-4) * K_kappa), " if it is in ",
                  is_mm ? "mm^2" : "cm^2");
  }
  const double least = kLeastExtensional * force, most = kMostExtensional * force;
  const double K_eps = parts.stiffness.K_eps.value_or(most);
  if (force == 0 || (K_eps >= least && K_eps <= most)) return;
  keys.complain(
      "", "has K_eps_n ", figure(K_eps), "; expected ", figure(least), " to ", figure(most),
      " N, from the pressures and muscle_radius_m: ", figure((K_eps < least ? 1e3 : 1e-3) * K_eps),
      " if it is in ", K_eps < least ? "kN" : "mN");
}

}  // namespace

model::Response readResponse(const MapReader& owner, const std::string& key) {
  model::Response response;
  double slow_time = 0.0, slow_weight = 0.0;
  const auto keys = owner.map(key, {{"rise_time_constant_s", kResponseTime, response.rise_time},
                                    {"fall_time_constant_s", kResponseTime, response.fall_time},
                                    "play_kpa",
                                    "play_weight",
                                    {"slow_time_constant_s", kSlowTime, slow_time},
                                    {"slow_weight", kPlayWeight, slow_weight}});
  if (!keys) return response;
  if (!keys->has("fall_time_constant_s")) response.fall_time = response.rise_time;
  if (keys->has("play_kpa")) {
    readPlays(*keys, response);
  } else if (keys->has("play_weight")) {
    keys->complain("play_weight", "is given without play_kpa; expected both or none");
  }
  addSlowState(*keys, slow_time, slow_weight, response);
  return response;
}

const char* keyOf(Argument argument) {
  return argument == Argument::kMean ? "mean_pressure_kpa" : "others_pressure_kpa";
}

Contractions readContractions(const MapReader& scene) {
  Contractions contractions;
  const std::string key = "contractions";
  const auto* curves = scene.entries(key, 0, "a map of named contraction curves");
  if (curves == nullptr) return contractions;
  for (const auto& [name, value] : *curves) {
    contractions[name] = readContraction(value, scene.path(joinPath(key, name)), scene.faults());
  }
  return contractions;
}

InheritedStiffness readStiffness(const MapReader& owner, InheritedStiffness stiffness) {
  model::Stiffness K{};
  model::BendingTable bending;
  const auto keys = owner.map(
      "stiffness", {Key("K_gamma", kStiffness, K.gamma).required(),
                    Key("K_tau_m2", kStiffness, K.tau).required(),
                    Key("K_kappa_m2", [&](const MapReader& map,
                                          const std::string&) { readKappa(map, K.kappa, bending); })
                        .required(),
                    "K_eps_n"});
  if (!keys) return stiffness;
  stiffness.value = K;
  stiffness.bending = bending;
  if (!keys->has("K_eps_n")) return stiffness;
  stiffness.K_eps = 1;
  stiffness.table = {};
  readEntry(*keys, kEpsKeys, *stiffness.K_eps, stiffness.table);
  return stiffness;
}

SectionParts readSection(const Value& value, const std::string& path, FaultList& faults,
                         ArmContext& arm) {
  SectionParts parts;
  SectionLook& look = parts.look;
  const MapReader keys(value, path,
                       {"name",
                        "stiffness",
                        "ring",
                        "actuators",
                        {"plate_m", within(kNotNegative, 0, 10, " m"), parts.section.plate},
                        {"separators", Whole{2, 1000}, look.separators},
                        {"separator_radius_m", kLength, look.separator_radius},
                        {"muscle_radius_m", kLength, look.muscle_radius}},
                       faults);
  look.name = keys.read("name", kWord).value_or("");
  if (!look.name.empty() && !arm.section_names.insert(look.name).second) {
    keys.fault("name", "a name that no other section has");
  }
  parts.stiffness = readStiffness(keys, arm.stiffness);
  const std::optional<std::size_t> layout = keys.exactlyOne({"ring", "actuators"});
  if (layout == 0) {
    if (!parts.stiffness.value) keys.fault("stiffness", "it here or in arm");
    readRing(keys, parts.stiffness, arm, parts.section);
  } else if (layout) {
    const bool listed = keys.eachOf("actuators", [&](const Value& one, const std::string& place) {
      readActuator(
          MapReader(one, place,
                    {"name", "position_m", "rpy_deg", "tilt_deg", "contraction", "length_scale",
                     "stroke_scale", "stiffness", "min_pressure_kpa", "max_pressure_kpa"},
                    faults),
          parts.stiffness, arm, parts.section);
    });
    if (!listed) return parts;
    const std::size_t count = keys.find("actuators")->entries.size();
    if (count > model::kMaxActuators) {
      keys.complainOfSize("actuators", count, "at most ", model::kMaxActuators);
    }
  }
  parts.section.bending = parts.stiffness.bending;
  checkTable(keys, kEpsKeys.key, parts.stiffness.table, parts.section);
  checkTable(keys, "K_kappa_m2", parts.section.bending, parts.section);
  checkStiffness(keys, parts);
  return parts;
}

}  // namespace helix_arm::io
