#pragma once

#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/vision/charuco_board.hpp"
#include "helix_arm/vision/tag_family.hpp"

namespace helix_arm::simulation {

/// What is printed on a flat card, row by row from its top left.
struct CardPrint {
  cv::Mat cells;               ///< (CV_8UC1) 0 or 255
  std::vector<double> across;  ///< width of each column of cells [units]
  std::vector<double> down;    ///< height of each row [units]
  double unit = 0;             ///< [m]

  double width() const;   ///< [units]
  double height() const;  ///< [units]
};

/// A tag with its white border; the unit is a cell.
/// @param size  side of the square that a detector finds [m].
/// @throws std::out_of_range on an unknown id.
CardPrint tagPrint(const vision::TagFamily& family, int id, double size);

/// A board with a white edge; the unit is a square.
/// @param board  valid.
CardPrint charucoPrint(const vision::CharucoBoard& board);

}  // namespace helix_arm::simulation
