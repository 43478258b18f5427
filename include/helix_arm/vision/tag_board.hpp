#pragma once

#include <string>

#include "helix_arm/estimation/tag_layout.hpp"
#include "helix_arm/vision/board_parts.hpp"

namespace helix_arm::vision {

/// A flat grid of tags that a camera is calibrated with. Ids count row by row from the top left.
///
/// The default is the board that `helix_arm tags --board` prints. It fits A4 and letter, so that
/// nobody has to say which paper a board was printed on. Its ids are the last ones of the family:
/// arms take theirs from the first.
struct TagBoard {
  std::string family = "36h11";
  int first_id = 557;
  int columns = 5, rows = 6;
  double tag_size = 0.028;  ///< outer edge of the black border [m]
  double pitch = 0.036;     ///< from one tag to the next, across and down [m]

  int count() const { return columns * rows; }
  bool has(int id) const { return id >= first_id && id < first_id + count(); }
  /// Extent of the tags, without the white around them [m].
  double width() const { return (columns - 1) * pitch + tag_size; }
  double height() const { return (rows - 1) * pitch + tag_size; }

  /// Corners of a tag [m] in the plane of the board: origin in its centre, x to the right, y up, as
  /// one reads it; the board's z points to the reader.
  /// @throws std::out_of_range on an id that the board does not have.
  estimation::Corners corners(int id) const;

  BoardParts parts() const;
};

}  // namespace helix_arm::vision
