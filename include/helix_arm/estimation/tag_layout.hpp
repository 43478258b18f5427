#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/arm.hpp"

namespace helix_arm::estimation {

/// The most tags an arm may carry.
inline constexpr int kMaxTags = 64;

/// Four points in the plane of a tag or of a picture, one a column: left below, right below, right
/// above, left above as one reads the tag. It is the order of libapriltag.
using Corners = Eigen::Matrix<double, 2, 4>;

/// Where one tag sits on the arm.
///
/// Tag frame T: origin in the middle, x to the right, y up, z out of the face, towards who reads
/// it.
struct TagPlacement {
  int id;         ///< in its family
  int section;    ///< counted from 0 at the base
  double s;       ///< along that section, in [0, 1]
  lie::SE3 X_ST;  ///< seen from the base curve's frame S at s [m]
};

/// All tags of an arm; of one size, measured over the outer edge of the black border.
struct TagLayout {
  double size = 0;  ///< [m]
  std::vector<TagPlacement> tags;

  /// Index of the tag with this id, -1 when there is none.
  int find(int id) const;
  /// Outer corners of the black border in T [m].
  /// @param bleed  that white bleeds into black at each edge: the border looks so much smaller [m].
  Corners corners(double bleed = 0.0) const;
  /// @throws std::invalid_argument naming the tag that breaks a rule: at most kMaxTags, ids differ
  /// and are >= 0, sections below `sections`, s in [0, 1], all finite, size > 0.
  void validate(int sections) const;
};

/// Poses X_BT of all tags on an arm of this shape, seen from its base.
std::vector<lie::SE3> tagPoses(const TagLayout& layout, const model::Twists& twists);

}  // namespace helix_arm::estimation
