#pragma once

#include <optional>
#include <vector>

#include "helix_arm/localization/camera.hpp"
#include "helix_arm/localization/tag_layout.hpp"

namespace helix_arm::estimation {

/// One camera looking at one arm; or a motion-capture system, if the layout has bodies: it has no
/// camera, and C is the frame of its poses.
struct ArmView {
  Camera camera;
  lie::SE3 X_CB;  ///< the arm's base seen from C
  TagLayout layout;
  int sections = 1;

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// A tag in the image of a camera.
struct TagImage {
  int tag;          ///< index in the layout
  Corners corners;  ///< [px]
};

/// Length of a tag's longest side, the one that is foreshortened least [px].
double longestSide(const Corners& corners);

/// Directions (x/z, y/z) of a tag's corners [px]; empty if the distortion cannot be inverted there.
std::optional<Corners> directionsOf(const Camera& camera, const Corners& corners);

/// The tags that face the camera and lie entirely in its image, for an arm of this shape; all
/// bodies, without corners. Occlusion is not considered.
///
/// @param least_cosine  minimum cosine of the angle between a tag's normal and its line of sight.
std::vector<TagImage> visibleTags(const ArmView& view, const model::Shape& shape,
                                  double least_cosine = 0.2);

}  // namespace helix_arm::estimation
