#include "arm_reader.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "pose_reader.hpp"
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

}  // namespace helix_arm::io
