#include <algorithm>
#include <limits>

#include "helix_arm/basics/pi.hpp"
#include "helix_arm/estimation/tag_layout.hpp"
#include "helix_arm/io/number.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/procedures/unrolled_tags.hpp"
#include "rig_check_parts.hpp"

namespace helix_arm::procedures {
namespace {

constexpr double kDegree = basics::kPi / 180;
constexpr double kInward = (90 + 1e-6) * kDegree;  // a face along the arm is none
constexpr double kOblique = 60 * kDegree;
constexpr double kAlong = 0.5;  // least cosine between the arm and the face of a tag on its end
// Tags side by side are this far apart, in sizes: they may share the white that a detector needs.
constexpr double kLeastPitch = 1.125;
constexpr double kSameFace = 0.87;  // cosine of 30 degrees
constexpr std::size_t kMostPairs = 20;

double skinRadius(const io::Scene& scene, int section, double s) {
  const io::SectionLook& look = scene.looks[static_cast<std::size_t>(section)];
  double radius = look.separator_radius;
  for (int i = scene.arm.firstActuator(section); i < scene.arm.firstActuator(section + 1); ++i) {
    const double centre = model::poseAlong(scene.arm.actuator(i), s).translation.tail<2>().norm();
    radius = std::max(radius, centre + look.muscle_radius);
  }
  return radius;
}

// Values of the tags, or pairs of tags, of which one finding tells.
struct Values {
  double least = std::numeric_limits<double>::infinity();
  double most = -std::numeric_limits<double>::infinity();

  void add(double value) {
    least = std::min(least, value);
    most = std::max(most, value);
  }
  // "5.4", or "5.4 to 7".
  std::string text() const {
    const std::string from = figure(least), to = figure(most);
    return from == to ? from : from + " to " + to;
  }
};

struct Tags {
  std::vector<int> ids;
  Values values;
  Values bounds;  // of which each value was held against its own, if they differ

  void add(int id, double value, double bound = 0) {
    ids.push_back(id);
    values.add(value);
    bounds.add(bound);
  }
  std::string culprit() const { return (ids.size() == 1 ? "tag " : "tags ") + io::listOf(ids); }
};

// A tag on the end of the arm that looks along it, not around it.
bool isOnEnd(const io::Scene& scene, const estimation::TagPlacement& tag) {
  return tag.section + 1 == scene.arm.sectionCount() && tag.s >= 1 &&
         tag.X_ST.rotation(0, 2) > kAlong;
}

void checkMounting(const io::Scene& scene, std::vector<Finding>& findings) {
  Tags off, inside, inward, oblique;
  const std::vector<UnrolledTag> tags = unrolled(scene.arm, *scene.tags);
  for (std::size_t i = 0; i < tags.size(); ++i) {
    const UnrolledTag& tag = tags[i];
    const double skin = skinRadius(scene, tag.section, tag.s);
    const double distance = tag.radius - skin;
    if (distance > kFarthestTag * skin) off.add(tag.id, 1e3 * distance, 1e3 * kFarthestTag * skin);
    if (isOnEnd(scene, scene.tags->tags[i])) continue;
    // The centre is within the circle of the muscles' inner sides, where nothing is glued to.
    if (tag.radius < 0.5 * skin) inside.add(tag.id, 1e3 * tag.radius, 1e3 * skin);
    if (tag.tilt > kInward) {
      inward.add(tag.id, tag.tilt / kDegree);
    } else if (tag.tilt > kOblique) {
      oblique.add(tag.id, tag.tilt / kDegree);
    }
  }
  if (!off.ids.empty()) {
    findings.push_back({Severity::kWarning, "tag_off_arm", off.culprit(),
                        "outside the arm's skin by " + off.values.text() +
                            " mm; expected at most the radius of the skin there, " +
                            off.bounds.text() + " mm",
                        "check position_m of the group: it counts from the actuator if the group "
                        "names one, otherwise from the base curve"});
  }
  if (!inside.ids.empty()) {
    findings.push_back({Severity::kFault, "tag_inside_arm", inside.culprit(),
                        "the centre is " + inside.values.text() +
                            " mm from the base curve, inside the arm, whose skin is at " +
                            inside.bounds.text() + " mm",
                        "set position_m of the group to where it is glued"});
  }
  if (!inward.ids.empty()) {
    findings.push_back({Severity::kFault, "tag_faces_inward", inward.culprit(),
                        "the face points " + inward.values.text() +
                            " deg from outwards; expected less than 90 deg",
                        "turn it by rpy_deg of the group, so that its z axis points away from the "
                        "arm"});
  }
  if (!oblique.ids.empty()) {
    findings.push_back({Severity::kNote, "tag_oblique", oblique.culprit(),
                        "the face points " + oblique.values.text() + " deg from outwards",
                        "check rpy_deg of the group"});
  }
}

struct Pairs {
  std::size_t count = 0;
  std::string names;
  Values distances;

  void add(int a, int b, double distance) {
    if (count < kMostPairs) {
      names += (count > 0 ? ", " : "") + std::to_string(a) + " and " + std::to_string(b);
    }
    ++count;
    distances.add(distance);
  }
  std::string culprit() const {
    return "tags " + names +
           (count > kMostPairs ? " and " + std::to_string(count - kMostPairs) + " more pairs" : "");
  }
};

void checkOverlaps(const io::Scene& scene, std::vector<Finding>& findings) {
  const model::Shape rest = model::shapeOf(scene.arm, scene.arm.unloaded(scene.arm.inputAt(0)));
  const std::vector<lie::SE3> poses = estimation::tagPoses(*scene.tags, rest);
  const double pitch = kLeastPitch * scene.tags->size;
  Pairs overlapping, close;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const double distance = (poses[i].translation - poses[j].translation).norm();
      const double facing = poses[i].rotation.col(2).dot(poses[j].rotation.col(2));
      if (distance >= pitch || facing < kSameFace) continue;
      Pairs& pairs = distance < scene.tags->size ? overlapping : close;
      pairs.add(scene.tags->tags[j].id, scene.tags->tags[i].id, 1e3 * distance);
    }
  }
  const auto tell = [&](Severity severity, const Pairs& pairs) {
    if (pairs.count == 0) return;
    findings.push_back({severity, "tags_overlap", pairs.culprit(),
                        "their centres are " + pairs.distances.text() + " mm apart; expected " +
                            figure(1e3 * pitch) + " mm, so that white is between them",
                        "move one of them along s, or print them smaller (tags.size_m)"});
  };
  tell(Severity::kFault, overlapping);
  tell(Severity::kWarning, close);
}

}  // namespace

void checkTags(const io::Scene& scene, std::vector<Finding>& findings) {
  if (!scene.tags) {
    findings.push_back({Severity::kNote, "no_tags", "tags",
                        "scene " + scene.name + " has none, so that nothing is measured",
                        "add the section tags, and print them with helix_arm tags"});
    return;
  }
  checkMounting(scene, findings);
  checkOverlaps(scene, findings);
}

}  // namespace helix_arm::procedures
