#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/shape.hpp"

namespace helix_arm::estimation {

/// Maximum number of tags on an arm.
inline constexpr int kMaxTags = 64;

/// Four points in the plane of a tag or an image, one per column: bottom left, bottom right, top
/// right, top left of the upright tag. This is the order of libapriltag.
using Corners = Eigen::Matrix<double, 2, 4>;

/// Expected standard deviations of a pose that a motion-capture system measures, each axis.
struct PoseNoise {
  double position = 0;  ///< > 0 [m]
  double rotation = 0;  ///< [rad]; 0: only positions are measured
};

/// Placement of one tag on the arm, or of a motion-capture body.
///
/// Tag frame T: origin in the centre, x to the right, y up, z out of the face, towards the viewer;
/// of a body, the frame that its system gives it.
struct TagPlacement {
  int id;         ///< id in its tag family
  int section;    ///< section index, counted from 0 at the base
  double s;       ///< position along that section, in [0, 1]
  lie::SE3 X_ST;  ///< seen from the base curve's frame S at s [m]
  /// Standard errors of a calibration that placed the tags, as displacements of movedBy() [m, rad]:
  /// of a tag that none of its captures shows, the deviations of the prior. 0 without one.
  lie::Vector6 error = lie::Vector6::Zero();
  bool placed = true;  ///< false: such a calibration has no capture that shows it
  /// Expected noise of a body's poses; absent for a tag.
  std::optional<PoseNoise> noise = std::nullopt;
  std::string name = {};  ///< of a body

  /// The name of a body, the id of a tag.
  std::string label() const { return noise ? name : std::to_string(id); }
};

/// All tags of an arm. They have one size, measured over vision::TagFamily::sizeEdge(). Or all its
/// motion-capture bodies, which are drawn with that size.
struct TagLayout {
  double size = 0;  ///< [m]
  std::vector<TagPlacement> tags;

  /// Whether a motion-capture system measures their poses, instead of a camera their corners.
  bool hasBodies() const {
    return std::any_of(tags.begin(), tags.end(), [](const auto& tag) { return tag.noise; });
  }
  /// Index of the tag with this id, or -1.
  int find(int id) const;
  /// Index of the tag nearest to the base, or -1 without tags: in the first section that has tags,
  /// with the smallest s, then the smallest id. A calibration of placements keeps this tag fixed.
  int baseTag() const;
  /// Outer corners of the black border in T [m].
  /// @param border_shift  width of white bleeding into black at each edge, by which the
  ///     border appears smaller [m].
  /// @return (2 x 4) a corner per column.
  Corners corners(double border_shift = 0.0) const;
  /// @throws std::invalid_argument naming the tag that breaks a rule: at most kMaxTags, unique ids
  ///     >= 0, sections below `sections`, s in [0, 1], all values finite, size > 0.
  void validate(int sections) const;
};

/// The placement of a tag after a displacement.
///
/// @param moved        [d; r]: d [m] along the arm at rest and along y and z of S; r [rad] the
///     rotation vector of the tag about its own centre, seen from T.
/// @param rest_length  of its section [m]: d_x changes s by d_x / rest_length. A displacement
///     beyond an end of the section is added along x of that end.
TagPlacement movedBy(const TagPlacement& tag, const lie::Vector6& moved, double rest_length);

/// Position of a tag on a shape with several pieces per section.
struct PiecePlace {
  int piece;  ///< piece index over all sections, counted from 0 at the base
  double s;   ///< position along that piece, in [0, 1]
};
PiecePlace placeOnPieces(const TagPlacement& tag, int pieces_per_section);  ///< where that tag is

/// Poses X_BT of all tags on an arm of this shape, seen from its base.
std::vector<lie::SE3> tagPoses(const TagLayout& layout, const model::Shape& shape);

/// Standard deviations of a tag's placement about the scene's value.
struct TagPrior {
  double translation = 0.002;  ///< along the arm, and across it on each axis [m]
  double rotation = 0.052;     ///< about each axis [rad]
};

}  // namespace helix_arm::estimation
