#pragma once

#include <cstdint>

#include "helix_arm/vision/tag_family.hpp"

/// Tags whose bits lie inside a black border on white.
namespace helix_arm::vision {

/// Maximum number of cells along a border, over all families with a closed one.
inline constexpr int kMostCells = 8;

/// The cells of one tag of a family with a closed border.
struct TagPattern {
  int cells;  ///< along a side of the border's outer edge
  /// White cells inside the border, row by row from the top, the first in bit 0.
  std::uint64_t white;
};

/// Whether all bits of the family's tags lie inside a black border on white. Only such tags can be
/// found by their edges.
bool hasClosedBorder(const TagFamily& family);

/// @throws std::out_of_range on an unknown id.
TagPattern patternOf(const TagFamily& family, int id);

/// Whether a cell belongs to the border; rows count from the top.
inline bool isBorder(const TagPattern& pattern, int row, int column) {
  const int last = pattern.cells - 1;
  return row == 0 || column == 0 || row == last || column == last;
}

inline bool isWhite(const TagPattern& pattern, int row, int column) {
  if (isBorder(pattern, row, column)) return false;
  return (pattern.white >> ((row - 1) * (pattern.cells - 2) + column - 1) & 1) != 0;
}

}  // namespace helix_arm::vision
