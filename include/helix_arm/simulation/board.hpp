#pragma once

#include <cstdint>
#include <vector>

#include "helix_arm/estimation/tag_sight.hpp"
#include "helix_arm/vision/tag_board.hpp"

namespace helix_arm::simulation {

/// Poses of a board, seen from the camera, as a person would hold it: near, all over the picture,
/// tilted to each side. Board frame: origin in its centre, x right, y up, z to the reader.
/// @param count  >= 0.
std::vector<lie::SE3> boardPoses(const estimation::Camera& camera, int count, std::uint32_t seed);

/// The board as the tags of an arm whose base is the camera.
/// @param X_CP  pose of the board, seen from the camera.
estimation::ArmView boardView(const estimation::Camera& camera, const vision::TagBoard& board,
                              const lie::SE3& X_CP);

}  // namespace helix_arm::simulation
