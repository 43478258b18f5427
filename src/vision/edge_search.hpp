#pragma once

#include <optional>

#include "gray_picture.hpp"

namespace helix_arm::vision {

/// Minimum side of a tag [px]: below it, a cell is hardly one pixel.
inline constexpr double kLeastSide = 10.0;
/// Maximum distance of a search for edges [px].
inline constexpr int kMaxReach = 16;

/// Whether sides are long enough and in the right order, and no corner is flat.
bool isTagLike(const estimation::Corners& corners);

/// Corners [px]: the intersections of the lines with the strongest change from white to black,
/// going into a tag. Nothing if there are none.
/// @param corners    where the tag is expected; tag-like.
/// @param max_reach  maximum distance from its edges [px], at most kMaxReach.
std::optional<estimation::Corners> searchEdges(const GrayPicture& picture,
                                               const estimation::Corners& corners, int max_reach);

}  // namespace helix_arm::vision
