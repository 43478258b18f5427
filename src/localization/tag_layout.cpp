#include "helix_arm/localization/tag_layout.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <tuple>

#include "helix_arm/model/curve.hpp"

namespace helix_arm::estimation {

int TagLayout::find(int id) const {
  for (std::size_t i = 0; i < tags.size(); ++i) {
    if (tags[i].id == id) return static_cast<int>(i);
  }
  return -1;
}

int TagLayout::baseTag() const {
  const auto nearest = std::min_element(tags.begin(), tags.end(), [](const auto& a, const auto& b) {
    return std::tie(a.section, a.s, a.id) < std::tie(b.section, b.s, b.id);
  });
  return nearest == tags.end() ? -1 : static_cast<int>(nearest - tags.begin());
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
      refuse(name + " is placed twice; expected distinct ids");
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

TagPlacement movedBy(const TagPlacement& tag, const lie::Vector6& moved, double rest_length) {
  TagPlacement out = tag;
  const double s = tag.s + moved[0] / rest_length;
  out.s = std::clamp(s, 0.0, 1.0);
  out.X_ST.translation += Eigen::Vector3d((s - out.s) * rest_length, moved[1], moved[2]);
  lie::Vector6 turn = lie::Vector6::Zero();
  turn.tail<3>() = moved.tail<3>();
  out.X_ST.rotation = tag.X_ST.rotation * lie::SE3::exp(turn).rotation;
  return out;
}

PiecePlace placeOnPieces(const TagPlacement& tag, int pieces_per_section) {
  const double along = pieces_per_section * tag.s;
  const int piece = std::min(static_cast<int>(along), pieces_per_section - 1);
  return {tag.section * pieces_per_section + piece, along - piece};
}

std::vector<lie::SE3> tagPoses(const TagLayout& layout, const model::Shape& shape) {
  std::vector<lie::SE3> poses;
  poses.reserve(layout.tags.size());
  for (const TagPlacement& tag : layout.tags) {
    poses.push_back(model::poseAt(shape, tag.section, tag.s) * tag.X_ST);
  }
  return poses;
}

}  // namespace helix_arm::estimation
