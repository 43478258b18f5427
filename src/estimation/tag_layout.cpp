#include "helix_arm/estimation/tag_layout.hpp"

#include <cmath>
#include <stdexcept>
#include <string>

#include "helix_arm/model/curve.hpp"

namespace helix_arm::estimation {

int TagLayout::find(int id) const {
  for (std::size_t i = 0; i < tags.size(); ++i) {
    if (tags[i].id == id) return static_cast<int>(i);
  }
  return -1;
}

Corners TagLayout::corners(double bleed) const {
  const double half = 0.5 * size - bleed;
  Corners out;
  out << -half, half, half, -half, -half, -half, half, half;
  return out;
}

void TagLayout::validate(int sections) const {
  const auto refuse = [](const std::string& message) { throw std::invalid_argument(message); };
  if (!(std::isfinite(size) && size > 0)) {
    refuse("the size of the tags is " + std::to_string(size) + " m; expected a value > 0");
  }
  if (tags.size() > static_cast<std::size_t>(kMaxTags)) {
    refuse(std::to_string(tags.size()) + " tags; expected at most " + std::to_string(kMaxTags));
  }
  for (std::size_t i = 0; i < tags.size(); ++i) {
    const TagPlacement& tag = tags[i];
    const std::string name = "tag " + std::to_string(tag.id);
    if (tag.id < 0) refuse(name + ": expected an id >= 0");
    if (find(tag.id) != static_cast<int>(i))
      refuse(name + " is placed twice; expected ids that differ");
    if (tag.section < 0 || tag.section >= sections) {
      refuse(name + " is on section " + std::to_string(tag.section) + "; expected 0 to " +
             std::to_string(sections - 1));
    }
    if (!(tag.s >= 0 && tag.s <= 1)) {
      refuse(name + " is at s = " + std::to_string(tag.s) + "; expected 0 to 1");
    }
    if (!tag.X_ST.rotation.allFinite() || !tag.X_ST.translation.allFinite()) {
      refuse(name + " has a pose that is not finite");
    }
  }
}

std::vector<lie::SE3> tagPoses(const TagLayout& layout, const model::Twists& twists) {
  std::vector<lie::SE3> poses;
  poses.reserve(layout.tags.size());
  for (const TagPlacement& tag : layout.tags) {
    poses.push_back(model::poseAt(twists, tag.section + tag.s) * tag.X_ST);
  }
  return poses;
}

}  // namespace helix_arm::estimation
