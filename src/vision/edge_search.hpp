#pragma once

#include <optional>

#include "gray_picture.hpp"

namespace helix_arm::vision {

/// Shortest side of a tag that is looked for [px]: below, a cell is hardly one pixel.
inline constexpr double kLeastSide = 10.0;
/// Largest reach of a search for edges [px].
inline constexpr int kMaxReach = 16;

/// Whether sides are long enough and in the right order, and no corner is flat.
bool isTagLike(const estimation::Corners& corners);

/// Corners [px] where the lines cross along which white turns to black most clearly, on the way
/// into a tag; nothing where there are none.
/// @param corners    where the tag is expected; tag-like.
/// @param max_reach  how far from its edges is searched [px], at most kMaxReach.
std::optional<estimation::Corners> searchEdges(const GrayPicture& picture,
                                               const estimation::Corners& corners, int max_reach);

}  // namespace helix_arm::vision
