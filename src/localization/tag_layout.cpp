#include "helix_arm/localization/tag_layout.hpp"

#include <cmath>
#include <tuple>

#include "helix_arm/basics/requirement.hpp"
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

Corners TagLayout::corners(double border_shift) const {
  const double half = 0.5 * size - border_shift;
  Corners out;
  out << -half, half, half, -half, -half, -half, half, half;
  return out;
}

void TagLayout::validate(int sections) const {
  basics::require(std::isfinite(size) && size > 0, "the size of the tags is ", std::to_string(size),
                  " m; expected a value > 0");
  basics::require(tags.size() <= static_cast<std::size_t>(kMaxTags), tags.size(),
                  " tags; expected at most ", kMaxTags);
  for (std::size_t i = 0; i < tags.size(); ++i) {
    const TagPlacement& tag = tags[i];
    const auto require = [&tag](bool holds, const auto&... fault) {
      basics::require(holds, "tag ", tag.id, fault...);
    };
    require(tag.id >= 0, ": expected an id >= 0");
    require(find(tag.id) == static_cast<int>(i), " is placed twice; expected distinct ids");
    require(tag.section >= 0 && tag.section < sections, " is on section ", tag.section,
            "; expected 0 to ", sections - 1);
    require(tag.s >= 0 && tag.s <= 1, " is at s = ", std::to_string(tag.s), "; expected 0 to 1");
    require(tag.X_ST.rotation.allFinite() && tag.X_ST.translation.allFinite(),
            " has a pose that is not finite");
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
