#include <algorithm>

#include "scene_readers.hpp"

namespace helix_arm::io {
namespace {

constexpr char kBasePlate[] = "base";      // the plate that the arm hangs from
constexpr double kDrawnSize = 0.03;        // side with which a body is drawn [m]
constexpr double kUsualPosition = 0.0002;  // noise [m]
constexpr double kUsualRotation = 0.2;     // noise [degrees]

// Where a body is fixed: to a section's base curve, to the base, to a plate or to the tip.
void readPlace(const MapReader& body, const ArmParts& parts, estimation::TagPlacement& out) {
  const auto kind = body.exactlyOne({"section", "plate", "tool"});
  const bool along = kind && *kind == 0;
  if (along) {
    out.s = body.read("s", kFraction).value_or(0.0);
  } else if (body.has("s")) {
    body.complain("s", "has no meaning for a body on a plate or tool; leave it out");
  }
  if (!kind) return;
  const model::Arm& arm = parts.arm;
  out.section = arm.sectionCount() - 1;
  if (along) {
    out.section = body.read("section", sectionsOf(parts)).value_or(0);
  } else if (*kind == 1) {
    OneOf<int> plates = sectionsOf(parts);
    plates.words.emplace_back(kBasePlate, -1);
    const int plate = body.read("plate", plates).value_or(0);
    out.section = std::max(plate, 0);
    out.s = plate < 0 ? 0.0 : 1.0;
    const Eigen::Vector3d end(plate < 0 ? 0.0 : arm.plate(out.section), 0, 0);
    out.X_ST.translation = end;
  } else if (const Value* tool = body.find("tool"); tool->text != "true") {
    body.fault("tool", "true, or one of section and plate in place of it");
  } else {
    out.s = 1.0;
    out.X_ST = arm.link(out.section);
  }
}

}  // namespace

std::optional<estimation::TagLayout> readBodies(const MapReader& scene, const ArmParts* arm) {
  if (!scene.has("bodies")) return std::nullopt;
  for (const char* other : {"tags", "camera"}) {
    if (!scene.has(other)) continue;
    scene.complain("bodies", "stands beside ", other,
                   "; expected camera and tags, or bodies of a motion-capture system");
  }
  estimation::TagLayout out;
  out.size = kDrawnSize;
  scene.eachOf("bodies", [&](const Value& value, const std::string& path) {
    estimation::TagPlacement body{static_cast<int>(out.tags.size()), 0, 0.0, {}};
    estimation::PoseNoise noise{kUsualPosition, kUsualRotation * kDegree};
    lie::SE3 X;
    std::vector<Key> keys = poseKeys(X, kCoordinate);
    keys.insert(
        keys.end(),
        {Key("name", kWord, body.name).required(),
         {"noise",
          {{"position_m", within(kPositive, 1e-6, 0.1, " m"), noise.position},
           {"rotation_deg", within(kNotNegative, 0, 90, " degrees"), noise.rotation, kDegree}}},
         "section",
         "plate",
         "tool",
         "s"});
    const MapReader map(value, path, keys, scene.faults());
    const auto same = std::find_if(out.tags.begin(), out.tags.end(),
                                   [&body](const auto& other) { return other.name == body.name; });
    if (same != out.tags.end())
      map.complain("name", "is ", body.name, " again; expected distinct names");
    if (arm != nullptr) readPlace(map, *arm, body);
    body.X_ST = body.X_ST * X;
    body.noise = noise;
    out.tags.push_back(std::move(body));
  });
  if (out.tags.size() > static_cast<std::size_t>(estimation::kMaxTags)) {
    scene.complainOfSize("bodies", out.tags.size(), "at most ", estimation::kMaxTags);
  }
  return out;
}

}  // namespace helix_arm::io
