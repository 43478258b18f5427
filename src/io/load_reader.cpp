#include "load_reader.hpp"

#include <algorithm>
#include <numeric>

#include "pose_reader.hpp"

namespace helix_arm::io {
namespace {

const NumberRule kMass = within(kNotNegative, 0, 1e3, " kg");
const NumberRule kAcceleration = within(kFinite, -1e3, 1e3, " m/s^2");
const NumberRule kForce = within(kFinite, -1e5, 1e5, " N");
const NumberRule kMoment = within(kFinite, -1e5, 1e5, " N m");
const NumberRule kAlongSection{"a number from 0 to 1", [](double s) { return s >= 0 && s <= 1; }};

constexpr double kStandardGravity = 9.81;  // [m/s^2]

Eigen::Vector3d readVector(const MapReader& keys, const std::string& key, const NumberRule& rule,
                           const Eigen::Vector3d& fallback = Eigen::Vector3d::Zero()) {
  return keys.has(key) ? vector3(keys.numbers(key, 3, rule)).value_or(fallback) : fallback;
}

std::vector<double> readMasses(const MapReader& load, const Value& value, const ArmParts* arm) {
  const Value* given = value.find("mass_kg");
  if (given == nullptr) {
    load.fault("mass_kg",
               "the mass of the whole arm [kg], or a list of one number per section; 0 "
               "if it is negligible");
    return {};
  }
  const std::size_t sections = arm == nullptr ? 0 : arm->looks.size();
  if (given->kind == Value::Kind::kList) {
    return load.numbers("mass_kg", sections, kMass).value_or(std::vector<double>(sections, 0.0));
  }
  const double whole = load.number("mass_kg", kMass, 0.0);
  std::vector<double> masses(sections);
  for (std::size_t k = 0; k < sections; ++k) {
    masses[k] = arm->arm.restLength(static_cast<int>(k));
  }
  const double length = std::accumulate(masses.begin(), masses.end(), 0.0);
  for (double& mass : masses) mass *= whole / length;
  return masses;
}

// Invalid values were reported; the point then has default values.
statics::PointLoad readPull(const MapReader& keys, const Eigen::Matrix3d& R_BW) {
  statics::PointLoad point;
  point.mass = keys.number("mass_kg", kMass, point.mass);
  point.offset = readVector(keys, "position_m", kCoordinate);
  point.force = R_BW * readVector(keys, "force_n", kForce);
  point.moment = R_BW * readVector(keys, "moment_nm", kMoment);
  if (!keys.has("mass_kg") && !keys.has("force_n") && !keys.has("moment_nm")) {
    keys.complain("", "has no effect; expected at least one of mass_kg, force_n and moment_nm");
  }
  return point;
}

statics::PointLoad readPoint(const MapReader& keys, const ArmParts* arm,
                             const Eigen::Matrix3d& R_BW) {
  statics::PointLoad point = readPull(keys, R_BW);
  point.s = keys.number("s", kAlongSection).value_or(point.s);
  if (arm == nullptr || !keys.has("section")) return point;
  std::vector<std::string> sections;
  for (const SectionLook& look : arm->looks) sections.push_back(look.name);
  if (const auto name = keys.choice("section", sections)) {
    const auto found = std::find(sections.begin(), sections.end(), *name);
    point.section = static_cast<int>(found - sections.begin());
  }
  return point;
}

std::optional<statics::Load> onlyStiffness(const ArmParts* arm) {
  if (arm == nullptr || arm->K_eps.empty()) return std::nullopt;
  statics::Load load;
  load.mass.assign(arm->K_eps.size(), 0.0);
  load.K_eps = arm->K_eps;
  load.tables = arm->tables;
  return load;
}

bool isWeightless(const statics::Load& load) {
  const auto none = [](double mass) { return mass == 0; };
  return std::all_of(load.mass.begin(), load.mass.end(), none) &&
         std::all_of(load.points.begin(), load.points.end(), [](const statics::PointLoad& point) {
           return point.mass == 0 && point.force.isZero(0) && point.moment.isZero(0);
         });
}

}  // namespace

std::optional<statics::Load> readLoad(const MapReader& scene, const Value& document,
                                      const ArmParts* arm, FaultList& faults) {
  const Value* value = document.find("load");
  if (value == nullptr) return onlyStiffness(arm);
  const std::size_t faults_before = faults.count();
  const MapReader keys(*value, scene.path("load"), {"gravity_m_s2", "mass_kg", "tip", "points"},
                       faults);
  if (value->kind != Value::Kind::kMap) return std::nullopt;
  const Eigen::Matrix3d R_BW = (arm == nullptr ? lie::SE3() : arm->X_WB).rotation.transpose();
  statics::Load load;
  load.gravity = R_BW * readVector(keys, "gravity_m_s2", kAcceleration,
                                   -kStandardGravity * Eigen::Vector3d::UnitZ());
  load.mass = readMasses(keys, *value, arm);
  if (const Value* tip = value->find("tip")) {
    load.points.push_back(
        readPull(MapReader(*tip, keys.path("tip"),
                           {"mass_kg", "position_m", "force_n", "moment_nm"}, faults),
                 R_BW));
    if (arm != nullptr) {
      statics::PointLoad& point = load.points.back();
      point.section = arm->arm.sectionCount() - 1;
      point.offset = arm->arm.link(point.section) * point.offset;
    }
  }
  const std::vector<Value::Entry>* points = keys.has("points") ? keys.list("points") : nullptr;
  for (std::size_t i = 0; points != nullptr && i < points->size(); ++i) {
    load.points.push_back(readPoint(
        MapReader((*points)[i].value, indexPath(keys.path("points"), i),
                  {"section", "s", "mass_kg", "position_m", "force_n", "moment_nm"}, faults),
        arm, R_BW));
  }
  if (arm == nullptr || faults.count() != faults_before) return std::nullopt;
  if (isWeightless(load)) {
    keys.fault("mass_kg",
               "a mass > 0 [kg], or a mass, a force or a moment at the tip or at points: the load "
               "is zero; leave out the key load if that is intended");
    return std::nullopt;
  }
  load.K_eps = arm->K_eps;
  load.tables = arm->tables;
  return load;
}

}  // namespace helix_arm::io
