#include "tag_reader.hpp"

#include <algorithm>
#include <cmath>

#include "helix_arm/vision/tag_detector.hpp"
#include "helix_arm/vision/tag_family.hpp"
#include "pose_reader.hpp"

namespace helix_arm::io {
namespace {

const NumberRule kAlongSection{"a number from 0 to 1", [](double s) { return s >= 0 && s <= 1; }};

bool wholeAndNotNegative(double x) { return x >= 0 && x == std::floor(x); }
const NumberRule kTagId{"a whole number >= 0", wholeAndNotNegative, 0, 1e6};

// A wider prior has no effect.
const NumberRule kPlacementShift = within(kPositive, 1e-6, 0.1, " m");
const NumberRule kPlacementTurn = within(kPositive, 1e-4, 90, " degrees");

// The frame of a group's poses: a section, and the frame of an actuator or (default) of the base
// curve.
struct Mount {
  int section = 0;
  std::optional<int> actuator;  // its index in the arm
};

// Index of the choice that a key names.
std::optional<int> indexOf(const MapReader& group, const std::string& key,
                           const std::vector<std::string>& names) {
  const std::optional<std::string> name = group.choice(key, names);
  if (!name) return std::nullopt;
  return static_cast<int>(std::find(names.begin(), names.end(), *name) - names.begin());
}

// Invalid keys were reported; the mount then has default values.
Mount readMount(const MapReader& group, const ArmParts& parts) {
  Mount mount;
  if (group.has("section")) {
    std::vector<std::string> sections;
    for (const SectionLook& look : parts.looks) sections.push_back(look.name);
    const std::optional<int> section = indexOf(group, "section", sections);
    if (!section) return mount;
    mount.section = *section;
  }
  if (group.has("actuator")) {
    std::vector<std::string> actuators;
    const int first = parts.arm.firstActuator(mount.section);
    for (int i = first; i < parts.arm.firstActuator(mount.section + 1); ++i) {
      actuators.push_back(parts.arm.actuator(i).name);
    }
    const std::optional<int> actuator = indexOf(group, "actuator", actuators);
    if (actuator) mount.actuator = first + *actuator;
  }
  return mount;
}

void readGroup(const MapReader& group, const std::string& family, int family_size,
               const ArmParts* arm, estimation::TagLayout& layout) {
  const auto ids = group.numbers("ids", 0, kTagId);
  const auto s = group.numbers("s", 0, kAlongSection);
  const lie::SE3 X_MT = readPose(group, kCoordinate);
  const Mount mount = arm ? readMount(group, *arm) : Mount();
  if (!ids) return;
  if (ids->empty()) group.complain("ids", "is empty; expected at least one tag");
  if (s && ids->size() != s->size()) {
    group.complain("s", "has " + std::to_string(s->size()) + " entries; expected " +
                            std::to_string(ids->size()) + ", one per id");
  }
  for (std::size_t i = 0; i < ids->size(); ++i) {
    const int id = static_cast<int>((*ids)[i]);
    if (id >= family_size) {
      group.complain("ids", "has " + std::to_string(id) + "; expected 0 to " +
                                std::to_string(family_size - 1) + ", the tags of " + family);
    }
    if (layout.find(id) >= 0) {
      group.complain("ids", "places tag " + std::to_string(id) + " again; expected distinct ids");
    }
    // A tag without s still counts, since its id is used.
    const double at = s && i < s->size() ? (*s)[i] : 0.0;
    const lie::SE3 X_SM =
        mount.actuator ? model::poseAlong(arm->arm.actuator(*mount.actuator), at) : lie::SE3();
    layout.tags.push_back({id, mount.section, at, X_SM * X_MT});
  }
}

}  // namespace

std::optional<TagParts> readTags(const MapReader& scene, const Value& document, const ArmParts* arm,
                                 FaultList& faults) {
  const Value* value = document.find("tags");
  if (value == nullptr) return std::nullopt;
  const MapReader tags(*value, scene.path("tags"),
                       {"family", "size_m", "placement_prior", "frame", "groups"}, faults);
  TagParts parts{vision::DetectorConfig().family, {}, {}, {}};
  if (tags.has("family")) {
    parts.family = tags.choice("family", vision::TagFamily::names()).value_or(parts.family);
  }
  parts.layout.size = tags.number("size_m", kLength).value_or(0.0);
  if (const Value* given = value->find("placement_prior")) {
    const MapReader prior(*given, tags.path("placement_prior"), {"translation_m", "rotation_deg"},
                          faults);
    parts.prior.translation =
        prior.number("translation_m", kPlacementShift, parts.prior.translation);
    if (const auto deg = prior.optionalNumber("rotation_deg", kPlacementTurn)) {
      parts.prior.rotation = radians(*deg);
    }
  }
  if (const Value* frame = value->find("frame")) {
    parts.X_BF = readPose(MapReader(*frame, tags.path("frame"), {"position_m", "rpy_deg"}, faults),
                          kCoordinate);
  }
  const std::vector<Value::Entry>* groups = tags.list("groups");
  if (groups == nullptr) return std::nullopt;
  const int family_size = vision::TagFamily(parts.family).count();
  for (std::size_t i = 0; i < groups->size(); ++i) {
    const MapReader group((*groups)[i].value, indexPath(tags.path("groups"), i),
                          {"section", "actuator", "ids", "s", "position_m", "rpy_deg"}, faults);
    readGroup(group, parts.family, family_size, arm, parts.layout);
  }
  if (parts.layout.tags.size() > static_cast<std::size_t>(estimation::kMaxTags)) {
    tags.complain("groups", "place " + std::to_string(parts.layout.tags.size()) +
                                " tags; expected at most " + std::to_string(estimation::kMaxTags));
  }
  return parts;
}

}  // namespace helix_arm::io
