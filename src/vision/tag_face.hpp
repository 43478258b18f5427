#pragma once

#include <Eigen/Core>

#include "closed_border.hpp"
#include "gray_picture.hpp"

namespace helix_arm::vision {

/// The face of a tag in a picture, which must outlive this object. Coordinates in cells: u to the
/// right and v downwards from its top left corner.
class TagFace {
 public:
  /// @param corners  [px] of the border's outer edge. @param cells  along it.
  TagFace(const GrayPicture& picture, const estimation::Corners& corners, int cells);

  /// Mean size of a cell along u and v [px].
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

/// A tag's bits as read from a face.
struct TagBits {
  bool closed = true;         ///< all of the border is black
  int wrong = 0;              ///< number of wrong bits
  double margin = 0;          ///< distance of black and white from the threshold [gray levels]
  Eigen::Vector3d threshold;  ///< between black and white, over (u, v, 1)
};
TagBits readBits(const TagFace& face, const TagPattern& pattern);

/// Maximum disagreement between a corner and the edges between the cells.
struct EdgeTolerance {
  double px;
  double cells;       ///< paper bends and lenses distort
  double deviations;  ///< standard deviations of the noise
  double most_px;     ///< upper bound for any noise
};

/// Whether the edges between the cells agree with the corners.
bool innerEdgesAgree(const TagFace& face, const TagPattern& pattern,
                     const Eigen::Vector3d& threshold, const EdgeTolerance& tolerance);

}  // namespace helix_arm::vision
