#pragma once

#include <Eigen/Core>

#include "closed_border.hpp"
#include "gray_picture.hpp"

namespace helix_arm::vision {

/// The face of a tag in the picture, which must outlive this; u to the right and v downwards from
/// its left upper corner, in cells.
class TagFace {
 public:
  /// @param corners  [px] of the border's outer edge. @param cells  along it.
  TagFace(const GrayPicture& picture, const estimation::Corners& corners, int cells);

  /// Sizes of a cell along u and v, on average [px].
  const Eigen::Vector2d& cell() const { return cell_; }

  /// Gray level at (u, v).
  double at(const Eigen::Vector2d& uv) const {
    return picture_.at((origin_ + axes_ * uv) / (1 + perspective_.dot(uv)));
  }

 private:
  const GrayPicture& picture_;
  Eigen::Vector2d origin_, perspective_, cell_;
  Eigen::Matrix2d axes_;
};

/// What the cells of a face show of a tag's bits.
struct TagBits {
  bool closed = true;         ///< all of the border is black
  int wrong = 0;              ///< bits that are not the tag's
  double margin = 0;          ///< of black and white from the threshold [gray levels]
  Eigen::Vector3d threshold;  ///< between black and white, over (u, v, 1)
};
TagBits readBits(const TagFace& face, const TagPattern& pattern);

/// How far off the edges between the cells may put a corner.
struct EdgeTolerance {
  double px;
  double cells;       ///< paper bends and lenses distort
  double deviations;  ///< standard ones, of the noise
  double most_px;     ///< whatever the noise
};

/// Whether the edges between the cells put the corners where they are.
bool innerEdgesAgree(const TagFace& face, const TagPattern& pattern,
                     const Eigen::Vector3d& threshold, const EdgeTolerance& tolerance);

}  // namespace helix_arm::vision
