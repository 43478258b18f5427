#include "arm_reader.hpp"

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

model::PlanarArm planarArm(const std::vector<model::Section>& sections) {
  std::vector<model::PlanarSection> planar(sections.size());
  for (std::size_t k = 0; k < sections.size(); ++k) {
    for (const model::Actuator& a : sections[k].actuators) {
      const lie::SE2 X_O{a.X_O.rotation.topLeftCorner<2, 2>(), a.X_O.translation.head<2>()};
      planar[k].actuators.push_back(
          {a.name, X_O, a.stiffness, a.contraction, a.limits, a.drive, a.response});
    }
  }
  return model::PlanarArm(std::move(planar));
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
  const MapReader arm(*value, scene.path("arm"), {"geometry", "base", "stiffness", "sections"},
                      faults);
  const std::size_t faults_before = faults.count();
  const auto geometry = arm.choice("geometry", {"planar", "spatial"});
  const lie::SE3 X_WB = readBase(arm, *value, faults);
  ArmContext context{
      geometry == "planar", readStiffness(arm, *value, {}, faults), contractions, faults, {}, {}};

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
    if (context.planar) planar = planarArm(sections);
    model::Arm spatial = planar ? model::embed(*planar) : model::Arm(std::move(sections));
    return ArmParts{X_WB, std::move(spatial), std::move(planar), std::move(looks),
                    std::move(K_eps)};
  } catch (const std::invalid_argument& error) {
    arm.complain("sections", std::string("do not form an arm: ") + error.what());
    return std::nullopt;
  }
}

}  // namespace helix_arm::io
