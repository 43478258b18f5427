#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/load_arm.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "scene_readers.hpp"

namespace helix_arm::io {
namespace {

// Pose of the tip, seen from the end of the last section's plate.
void readTool(const MapReader& arm, const std::string& key, bool planar, lie::SE3& X,
              std::optional<clearance::ToolBody>& body) {
  const std::vector<Key> pose = poseKeys(X, kCoordinate);
  const MapReader keys = *arm.map(key, {pose[0], pose[1], "body"});
  body = readToolBody(keys);
  if (planar && X.translation.z() != 0) {
    keys.complain("position_m", "leaves the plane; expected z = 0 in a planar arm");
  }
  if (planar && std::abs(X.rotation(2, 2) - 1.0) > 0) {
    keys.complain("rpy_deg", "leaves the plane; expected roll and pitch 0 in a planar arm");
  }
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
    planar[k].bending = sections[k].bending;
  }
  return model::PlanarArm(std::move(planar), inPlane(tool));
}

// K_eps of each section [N]; missing values are faults under load.
std::vector<double> extensionalStiffness(const MapReader& scene,
                                         const std::vector<SectionParts>& sections) {
  std::vector<double> values;
  std::string lacking;
  for (const auto& [section, look, stiffness] : sections) {
    if (stiffness.K_eps) {
      values.push_back(*stiffness.K_eps);
    } else {
      lacking += (lacking.empty() ? "" : ", ") + look.name;
    }
  }
  if (!lacking.empty() && scene.has("load")) {
    const Value& arm = *scene.find("arm");
    const Value* stiffness = arm.find("stiffness");
    report(
        scene.faults(), (stiffness == nullptr ? arm : *stiffness).place,
        joinPath(scene.path("arm"), "stiffness.K_eps_n"),
        " is missing; expected a finite value > 0 [N], the extensional stiffness of one "
        "actuator, which the key load needs; missing there and in their own stiffness: sections ",
        lacking);
  }
  if (values.size() != sections.size()) values.clear();
  return values;
}

const OneOf<bool> kGeometry{{{"planar", true}, {"spatial", false}}};

// Reads `arm`; nothing if faults leave no arm.
std::optional<ArmParts> readArm(const MapReader& scene, const Contractions& contractions) {
  FaultList& faults = scene.faults();
  bool planar = false;
  lie::SE3 X_WB, tool;
  std::optional<clearance::ToolBody> tool_body;
  scene.required("arm", "a map");
  const auto arm = scene.map("arm", {Key("geometry", kGeometry, planar).required(),
                                     {"base", poseKeys(X_WB, kFinite)},
                                     "stiffness",
                                     "sections",
                                     {"tool", [&](const MapReader& map, const std::string& key) {
                                        readTool(map, key, planar, tool, tool_body);
                                      }}});
  if (!arm) return std::nullopt;
  ArmContext context{planar, readStiffness(*arm, {}), contractions};
  std::vector<SectionParts> parts;
  const bool listed = arm->eachOf("sections", [&](const Value& value, const std::string& path) {
    parts.push_back(readSection(value, path, faults, context));
  });
  if (!listed) return std::nullopt;
  if (parts.size() > model::kMaxSections) {
    arm->complainOfSize("sections", parts.size(), "at most ", model::kMaxSections);
  }
  std::vector<statics::StiffnessTable> tables;
  for (const SectionParts& one : parts) tables.push_back(one.stiffness.table);
  if (std::all_of(tables.begin(), tables.end(), [](const auto& one) { return one.empty(); })) {
    tables.clear();
  }
  const std::vector<double> K_eps = extensionalStiffness(scene, parts);
  // An unknown contraction omits its actuators, which is not a fault of their own.
  if (!arm->isSound()) return std::nullopt;
  std::vector<model::Section> sections;
  std::vector<SectionLook> looks;
  for (SectionParts& one : parts) {
    if (one.section.actuators.empty()) return std::nullopt;
    sections.push_back(std::move(one.section));
    looks.push_back(std::move(one.look));
  }
  try {
    std::optional<model::PlanarArm> flat;
    if (planar) flat = planarArm(sections, tool);
    const model::Arm spatial = flat ? model::embed(*flat) : model::Arm(std::move(sections), tool);
    return ArmParts{X_WB, spatial, flat, looks, K_eps, tables, tool_body};
  } catch (const std::invalid_argument& error) {
    arm->complain("sections", "do not form an arm: ", error.what());
    return std::nullopt;
  }
}

constexpr NumberRule kMass = within(kNotNegative, 0, 1e3, " kg");
constexpr double kStandardGravity = 9.81;  // [m/s^2]

std::vector<double> readMasses(const MapReader& load, const ArmParts* arm) {
  if (!load.has("mass_kg")) {
    load.fault("mass_kg",
               "the mass of the whole arm [kg], or a list of one number per section; 0 "
               "if it is negligible");
    return {};
  }
  const std::size_t sections = arm == nullptr ? 0 : arm->looks.size();
  std::vector<double> masses(sections);
  if (load.isList("mass_kg")) {
    Key("mass_kg", Numbers{kMass, sections}, masses).read(load);
    return masses;
  }
  double whole = 0, length = 0;
  Key("mass_kg", kMass, whole).read(load);
  for (std::size_t k = 0; k < sections; ++k) {
    length += masses[k] = arm->arm.restLength(static_cast<int>(k));
  }
  for (double& mass : masses) mass *= whole / length;
  return masses;
}

std::vector<Key> pullKeys(statics::PointLoad& point) {
  return {{"mass_kg", kMass, point.mass},
          {"position_m", kCoordinate, point.offset},
          {"force_n", within(kFinite, -1e5, 1e5, " N"), point.force},
          {"moment_nm", within(kFinite, -1e5, 1e5, " N m"), point.moment}};
}

// Turns a pull as the file gives it into the base.
void turnPull(const MapReader& keys, const Eigen::Matrix3d& R_BW, statics::PointLoad& point) {
  point.force = R_BW * point.force;
  point.moment = R_BW * point.moment;
  if (!keys.has("mass_kg") && !keys.has("force_n") && !keys.has("moment_nm")) {
    keys.complain("", "has no effect; expected at least one of mass_kg, force_n and moment_nm");
  }
}

// Invalid values were reported; the point then has default values.
statics::PointLoad readPoint(const Value& value, const std::string& path, const ArmParts* arm,
                             const Eigen::Matrix3d& R_BW, FaultList& faults) {
  statics::PointLoad point;
  std::vector<Key> rows = pullKeys(point);
  rows.insert(rows.begin(), {"section", Key("s", kFraction, point.s).required()});
  const MapReader keys(value, path, rows, faults);
  turnPull(keys, R_BW, point);
  if (arm != nullptr) Key("section", sectionsOf(*arm), point.section).read(keys);
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

// Reads `load`; values given in the world frame are rotated into the base. If the scene has none
// but the arm has K_eps, a load that is empty except for K_eps. Nothing with neither, or faults.
// @param arm  null if faults leave no arm; the faults of `load` itself are still found.
std::optional<statics::Load> readLoad(const MapReader& scene, const ArmParts* arm) {
  const Eigen::Matrix3d R_BW = (arm == nullptr ? lie::SE3() : arm->X_WB).rotation.transpose();
  statics::Load load;
  statics::PointLoad tip;
  load.gravity = -kStandardGravity * Eigen::Vector3d::UnitZ();
  const auto keys = scene.map(
      "load",
      {{"gravity_m_s2", within(kFinite, -1e3, 1e3, " m/s^2"), load.gravity},
       "mass_kg",
       {"tip", [&](const MapReader& map,
                   const std::string& key) { turnPull(*map.map(key, pullKeys(tip)), R_BW, tip); }},
       "points"});
  if (!keys) return onlyStiffness(arm);
  if (!keys->isMap()) return std::nullopt;
  load.gravity = R_BW * load.gravity;
  load.mass = readMasses(*keys, arm);
  if (keys->has("tip") && arm != nullptr) {
    tip.section = arm->arm.sectionCount() - 1;
    tip.offset = arm->arm.link(tip.section) * tip.offset;
    load.points.push_back(tip);
  }
  if (keys->has("points")) {
    keys->eachOf("points", [&](const Value& value, const std::string& path) {
      load.points.push_back(readPoint(value, path, arm, R_BW, scene.faults()));
    });
  }
  if (arm == nullptr || !keys->isSound()) return std::nullopt;
  if (isWeightless(load)) {
    keys->fault("mass_kg",
                "a mass > 0 [kg], or a mass, a force or a moment at the tip or at points: the load "
                "is zero; leave out the key load if that is intended");
    return std::nullopt;
  }
  load.K_eps = arm->K_eps;
  load.tables = arm->tables;
  return load;
}

// statics::kLeastTipError in percent.
constexpr double kLeastPercent = 2e-7;
constexpr NumberRule kTipError = within(kPositive, kLeastPercent, 100, " % of the arm's length");
constexpr NumberRule kTime = within(kPositive, 1e-3, 1e9, " us");

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
    scene.fault("tier", allowed(false, true), ", since arm.geometry is spatial");
  }
  if (statics::takesLoad(tier) && !scene.has("load") && arm.K_eps.empty()) {
    scene.fault("tier", allowed(planar, false), ", since the scene has no key load; or add it");
  }
}

// Reads `tier`, `order`, `accuracy` and `budget`, which choose how shapes are computed.
// @param arm  null if faults leave no arm; then the request is not checked against it.
statics::TierRequest readTierRequest(const MapReader& scene, const ArmParts* arm) {
  statics::TierRequest request;
  std::string tier = statics::kAutoTier;
  bool known = true;
  if (scene.has("tier")) {
    const auto word = scene.read("tier", oneOf(statics::tierWords()));
    known = word.has_value();
    tier = word.value_or(tier);
    request.tier = statics::tierNamed(tier);
  }
  if (request.tier && arm) checkSceneAllows(scene, *request.tier, *arm);
  Key("order", Whole{statics::kLeastOrder, statics::kMostOrder}, request.order).read(scene);
  if (scene.has("order") && known && tier != "loaded") {
    scene.complain("order", "applies to tier: loaded, but tier is ", tier,
                   "; expected tier: loaded, or no order");
  }
  std::optional<double> percent;
  scene.map("accuracy", {Key("tip_error_percent", kTipError, percent).required()});
  if (percent) request.relative_tip_error = *percent / 100;
  scene.map("budget", {Key("time_us", kTime, request.time, 1e-6).required()});
  if (scene.has("accuracy") && scene.has("budget")) {
    scene.complain("budget", "is given together with accuracy; expected only one");
  }
  const bool chosen = tier != statics::kAutoTier && (tier != "loaded" || scene.has("order"));
  for (const char* key : {"accuracy", "budget"}) {
    if (!scene.has(key) || !known || !chosen) continue;
    scene.complain(key, "has no effect, since tier is ", tier,
                   tier == "loaded" ? " with an order" : "",
                   "; expected tier: auto, or loaded without an order");
  }
  return request;
}

// Absent if the parts that it needs have faults.
std::optional<statics::ArmModel> readModel(const MapReader& scene, const ArmParts* arm) {
  const std::size_t faults_before = scene.faults().count();
  std::optional<statics::Load> load = readLoad(scene, arm);
  const statics::TierRequest request = readTierRequest(scene, arm);
  if (arm == nullptr || scene.faults().count() != faults_before) return std::nullopt;
  try {
    return statics::ArmModel(arm->arm, arm->planar, std::move(load), request);
  } catch (const basics::Requirement& error) {
    scene.report(error.key.substr(0, error.key.find('.')), error.what());
  } catch (const std::invalid_argument& error) {
    scene.report("", error.what());
  }
  return std::nullopt;
}

}  // namespace

const DocumentKind& sceneKind() {
  static const DocumentKind kind{
      {"name",   "contractions", "arm",        "load",     "dynamics",    "tier",
       "order",  "accuracy",     "budget",     "tags",     "bodies",      "motion_capture",
       "camera", "vision",       "simulation", "keep_out", "clearance_m", "regulator",
       "safety", "follow",       "calibration"},
      {"name", "contractions", "arm"},
      2};
  return kind;
}

std::string readSceneText(const std::string& path, FaultList& faults) {
  const std::optional<std::string> text = readTextFile(path, kMostSceneBytes, faults);
  faults.throwIfAny();
  return *text;
}

Value parseScene(const std::string& text, const std::vector<Override>& overrides,
                 FaultList& faults) {
  std::optional<Value> document = parseDocument(text, sceneKind(), faults);
  if (!document) faults.throwIfAny();
  for (const Override& change : overrides) applyOverride(*document, change, faults);
  return std::move(*document);
}

OneOf<int> sectionsOf(const ArmParts& arm) {
  OneOf<int> sections;
  for (const SectionLook& look : arm.looks) {
    sections.words.emplace_back(look.name, static_cast<int>(sections.words.size()));
  }
  return sections;
}

SceneArmParts readSceneArm(const MapReader& scene) {
  SceneArmParts parts;
  parts.name = scene.read("name", kWord);
  parts.contractions = readContractions(scene);
  parts.arm = readArm(scene, parts.contractions);
  parts.model = readModel(scene, parts.arm ? &*parts.arm : nullptr);
  return parts;
}

SceneArm loadArm(const std::string& path, const std::vector<Override>& overrides) {
  FaultList faults(path);
  const Value document = parseScene(readSceneText(path, faults), overrides, faults);
  SceneArmParts parts = readSceneArm(MapReader(document, "", keysOf(sceneKind().keys), faults));
  faults.throwIfAny();
  return {std::move(*parts.name), parts.arm->X_WB, std::move(*parts.model),
          std::move(parts.arm->looks)};
}

}  // namespace helix_arm::io
