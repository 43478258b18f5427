#include "arm_reader.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>
#include <vector>

#include "helix_arm/io/load_arm.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "io/document/document.hpp"
#include "io/document/map_reader.hpp"
#include "section_reader.hpp"

namespace helix_arm::io {
namespace {

lie::SE3 readBase(const MapReader& arm, const Value& value, FaultList& faults) {
  const Value* given = value.find("base");
  if (given == nullptr) return {};
  return readPose(MapReader(*given, arm.path("base"), {"position_m", "rpy_deg"}, faults), kFinite);
}

// Pose of the tip, seen from the end of the last section's plate.
lie::SE3 readTool(const MapReader& arm, const Value& value, bool planar, FaultList& faults) {
  const Value* given = value.find("tool");
  if (given == nullptr) return {};
  const MapReader keys(*given, arm.path("tool"), {"position_m", "rpy_deg"}, faults);
  const lie::SE3 X = readPose(keys, kCoordinate);
  if (planar && X.translation.z() != 0) {
    keys.complain("position_m", "leaves the plane; expected z = 0 in a planar arm");
  }
  if (planar && std::abs(X.rotation(2, 2) - 1.0) > 0) {
    keys.complain("rpy_deg", "leaves the plane; expected roll and pitch 0 in a planar arm");
  }
  return X;
}

lie::SE2 inPlane(const lie::SE3& X) {
  return {X.rotation.topLeftCorner<2, 2>(), X.translation.head<2>()};
}

model::PlanarArm planarArm(const std::vector<model::Section>& sections, const lie::SE3& tool) {
  std::vector<model::PlanarSection> planar(sections.size());
  for (std::size_t k = 0; k < sections.size(); ++k) {
    for (const model::Actuator& a : sections[k].actuators) {
      planar[k].actuators.push_back(
          {a.name, inPlane(a.X_O), a.stiffness, a.contraction, a.limits, a.drive, a.response});
      for (const lie::SE3& X_O : a.taper) {
        planar[k].actuators.back().taper.push_back(inPlane(X_O));
      }
    }
    planar[k].plate = sections[k].plate;
  }
  return model::PlanarArm(std::move(planar), inPlane(tool));
}

// Of each section [N]; missing values are faults under load.
std::vector<double> extensionalStiffness(const MapReader& scene, const Value& arm,
                                         const std::vector<SectionParts>& sections,
                                         FaultList& faults) {
  std::vector<double> values;
  std::string lacking;
  for (const SectionParts& parts : sections) {
    if (parts.K_eps) values.push_back(*parts.K_eps);
    if (!parts.K_eps_given) lacking += (lacking.empty() ? "" : ", ") + parts.look.name;
  }
  if (!lacking.empty() && scene.has("load")) {
    const Value* stiffness = arm.find("stiffness");
    report(faults, (stiffness == nullptr ? arm : *stiffness).place,
           joinPath(scene.path("arm"), "stiffness.K_eps_n") +
               " is missing; expected a finite value > 0 [N], the extensional stiffness of one "
               "actuator, which the key load needs; missing there and in their own stiffness: "
               "sections " +
               lacking);
  }
  if (values.size() != sections.size()) values.clear();
  return values;
}

}  // namespace

std::optional<ArmParts> readArm(const MapReader& scene, const Contractions& contractions,
                                FaultList& faults) {
  const Value* value = scene.required("arm", "a map");
  if (value == nullptr) return std::nullopt;
  const MapReader arm(*value, scene.path("arm"),
                      {"geometry", "base", "stiffness", "sections", "tool"}, faults);
  const std::size_t faults_before = faults.count();
  const auto geometry = arm.choice("geometry", {"planar", "spatial"});
  const lie::SE3 X_WB = readBase(arm, *value, faults);
  ArmContext context{
      geometry == "planar", readStiffness(arm, *value, {}, faults), contractions, faults, {}, {}};

  const lie::SE3 tool = readTool(arm, *value, context.planar, faults);
  std::vector<SectionParts> parts;
  const std::vector<Value::Entry>* entries = arm.list("sections");
  if (entries == nullptr) return std::nullopt;
  for (std::size_t k = 0; k < entries->size(); ++k) {
    parts.push_back(readSection((*entries)[k].value, indexPath(arm.path("sections"), k), context));
  }
  if (parts.size() > model::kMaxSections) {
    arm.complain("sections", "has " + std::to_string(parts.size()) + " entries; expected at most " +
                                 std::to_string(model::kMaxSections));
  }
  std::vector<statics::StiffnessTable> tables;
  for (const SectionParts& one : parts) tables.push_back(one.table);
  if (std::all_of(tables.begin(), tables.end(), [](const auto& one) { return one.empty(); })) {
    tables.clear();
  }
  std::vector<double> K_eps = extensionalStiffness(scene, *value, parts, faults);
  // An unknown contraction omits its actuators, which is not a fault of their own.
  if (faults.count() != faults_before) return std::nullopt;
  std::vector<model::Section> sections;
  std::vector<SectionLook> looks;
  for (SectionParts& one : parts) {
    if (one.section.actuators.empty()) return std::nullopt;
    sections.push_back(std::move(one.section));
    looks.push_back(std::move(one.look));
  }
  try {
    std::optional<model::PlanarArm> planar;
    if (context.planar) planar = planarArm(sections, tool);
    model::Arm spatial = planar ? model::embed(*planar) : model::Arm(std::move(sections), tool);
    return ArmParts{X_WB,
                    std::move(spatial),
                    std::move(planar),
                    std::move(looks),
                    std::move(K_eps),
                    std::move(tables)};
  } catch (const std::invalid_argument& error) {
    arm.complain("sections", std::string("do not form an arm: ") + error.what());
    return std::nullopt;
  }
}

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

namespace {

// statics::kLeastTipError in percent.
constexpr double kLeastPercent = 2e-7;
const NumberRule kTipError = within(kPositive, kLeastPercent, 100, " % of the arm's length");
const NumberRule kTime = within(kPositive, 1e-3, 1e9, " us");

// The number in a map with a single key.
std::optional<double> readOnly(const MapReader& scene, const Value& document,
                               const std::string& key, const std::string& number,
                               const NumberRule& rule, FaultList& faults) {
  const Value* value = document.find(key);
  if (value == nullptr) return std::nullopt;
  return MapReader(*value, scene.path(key), {number}, faults).number(number, rule);
}

// The words for tiers that a scene allows.
std::string allowed(bool planar, bool loaded) {
  std::vector<std::string> words = {statics::kAutoTier};
  for (const statics::Tier tier : statics::kTiers) {
    if (tier == statics::Tier::kPlanar && !planar) continue;
    if (loaded || !statics::takesLoad(tier)) words.emplace_back(statics::nameOf(tier));
  }
  return alternatives(words);
}

void checkSceneAllows(const MapReader& scene, statics::Tier tier, const ArmParts& arm) {
  const bool planar = arm.planar.has_value();
  if (tier == statics::Tier::kPlanar && !planar) {
    scene.fault("tier", allowed(false, true) + ", since arm.geometry is spatial");
  }
  if (statics::takesLoad(tier) && !scene.has("load") && arm.K_eps.empty()) {
    scene.fault("tier", allowed(planar, false) + ", since the scene has no key load; or add it");
  }
}

}  // namespace

statics::TierRequest readTierRequest(const MapReader& scene, const Value& document,
                                     const ArmParts* arm, FaultList& faults) {
  statics::TierRequest request;
  std::string tier = statics::kAutoTier;
  bool known = true;
  if (scene.has("tier")) {
    const auto word = scene.choice("tier", statics::tierWords());
    known = word.has_value();
    tier = word.value_or(tier);
    request.tier = statics::tierNamed(tier);
  }
  if (request.tier && arm) checkSceneAllows(scene, *request.tier, *arm);
  if (scene.has("order")) {
    if (const auto order = scene.integer("order", statics::kLeastOrder, statics::kMostOrder)) {
      request.order = static_cast<int>(*order);
    }
    if (known && tier != "loaded") {
      scene.complain("order", "applies to tier: loaded, but tier is " + tier +
                                  "; expected tier: loaded, or no order");
    }
  }
  const auto percent =
      readOnly(scene, document, "accuracy", "tip_error_percent", kTipError, faults);
  if (percent) request.relative_tip_error = *percent / 100;
  const auto us = readOnly(scene, document, "budget", "time_us", kTime, faults);
  if (us) request.time = *us * 1e-6;
  if (scene.has("accuracy") && scene.has("budget")) {
    scene.complain("budget", "is given together with accuracy; expected only one");
  }
  const bool chosen = tier != statics::kAutoTier && (tier != "loaded" || scene.has("order"));
  for (const char* key : {"accuracy", "budget"}) {
    if (!scene.has(key) || !known || !chosen) continue;
    const std::string what = tier + (tier == "loaded" ? " with an order" : "");
    scene.complain(key, "has no effect, since tier is " + what +
                            "; expected tier: auto, or loaded without an order");
  }
  return request;
}

namespace {

// Absent if the parts that it needs have faults.
std::optional<statics::ArmModel> readModel(const MapReader& scene, const Value& document,
                                           const ArmParts* arm, FaultList& faults) {
  const std::size_t faults_before = faults.count();
  std::optional<statics::Load> load = readLoad(scene, document, arm, faults);
  const statics::TierRequest request = readTierRequest(scene, document, arm, faults);
  if (arm == nullptr || faults.count() != faults_before) return std::nullopt;
  try {
    return statics::ArmModel(arm->arm, arm->planar, std::move(load), request);
  } catch (const std::invalid_argument& error) {
    // The message begins with the key.
    const std::string fault = error.what();
    const Value* key = document.find(fault.substr(0, fault.find_first_of(".:")));
    report(faults, (key == nullptr ? document : *key).place, fault);
    return std::nullopt;
  }
}

}  // namespace

const DocumentKind& sceneKind() {
  static const DocumentKind kind{
      {"name", "contractions", "arm", "load", "tier", "order", "accuracy", "budget", "tags",
       "camera", "vision", "simulation", "regulator", "safety", "follow", "calibration"},
      {"name", "contractions", "arm"},
      2};
  return kind;
}

std::string readSceneText(const std::string& path, FaultList& faults) {
  const std::optional<std::string> text = readTextFile(path, kMostSceneBytes, faults);
  faults.throwIfAny();
  return *text;
}

std::optional<Value> parseScene(const std::string& text, FaultList& faults) {
  return parseDocument(text, sceneKind(), faults);
}

Value parseScene(const std::string& text, const std::vector<Override>& overrides,
                 FaultList& faults) {
  std::optional<Value> document = parseScene(text, faults);
  if (!document) faults.throwIfAny();
  for (const Override& change : overrides) applyOverride(*document, change, faults);
  return std::move(*document);
}

SceneArmParts readSceneArm(const MapReader& scene, const Value& document, FaultList& faults) {
  SceneArmParts parts;
  parts.name = scene.word("name");
  parts.contractions = readContractions(scene, faults);
  parts.arm = readArm(scene, parts.contractions, faults);
  parts.model = readModel(scene, document, parts.arm ? &*parts.arm : nullptr, faults);
  return parts;
}

SceneArm loadArm(const std::string& path, const std::vector<Override>& overrides) {
  FaultList faults(path);
  const Value document = parseScene(readSceneText(path, faults), overrides, faults);
  SceneArmParts parts =
      readSceneArm(MapReader(document, "", sceneKind().keys, faults), document, faults);
  faults.throwIfAny();
  return {std::move(*parts.name), parts.arm->X_WB, std::move(*parts.model),
          std::move(parts.arm->looks)};
}

}  // namespace helix_arm::io
