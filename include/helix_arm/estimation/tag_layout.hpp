#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/shape.hpp"

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
  /// Index of the tag nearest to the base: of the first section, of those the least s, of those the
  /// least id; -1 when there is none. Where tags move on their arm, it is the one that does not.
  int baseTag() const;
  /// Outer corners of the black border in T [m].
  /// @param bleed  that white bleeds into black at each edge: the border looks so much smaller [m].
  Corners corners(double bleed = 0.0) const;
  /// @throws std::invalid_argument naming the tag that breaks a rule: at most kMaxTags, ids differ
  /// and are >= 0, sections below `sections`, s in [0, 1], all finite, size > 0.
  void validate(int sections) const;
};

/// A tag glued elsewhere than its placement says.
///
/// @param moved        [d; r]: d [m] along the resting arm and along y and z of S; r [rad] the
///                     rotation vector that turns the tag about its own centre, seen from T.
/// @param rest_length  of its section [m]: d_x changes s by d_x / rest_length. What leads beyond an
///                     end of the section is carried by that end, along its x.
TagPlacement movedBy(const TagPlacement& tag, const lie::Vector6& moved, double rest_length);

/// Where a tag sits on a shape whose sections are several pieces each.
struct PiecePlace {
  int piece;  ///< counted from 0 at the base, over all sections
  double s;   ///< along that piece, in [0, 1]
};
PiecePlace placeOnPieces(const TagPlacement& tag, int pieces_per_section);

/// Poses X_BT of all tags on an arm of this shape, seen from its base.
std::vector<lie::SE3> tagPoses(const TagLayout& layout, const model::Shape& shape);

}  // namespace helix_arm::estimation
