#pragma once

#include <cstdint>
#include <vector>

#include "helix_arm/simulation/camera.hpp"
#include "helix_arm/vision/charuco_board.hpp"

namespace helix_arm::simulation {

/// Poses of a board, seen from the camera, as a person would hold it: near, all over the picture,
/// tilted to each side. Board frame: origin in its centre, x right, y up, z to the reader.
/// @param count  >= 0.
std::vector<lie::SE3> boardPoses(const estimation::Camera& camera, int count, std::uint32_t seed);

/// A camera that sees a board and no arm: the board is its layout, on the base, which is the
/// camera.
/// @param X_CP  pose of the board, seen from the camera.
/// @throws std::invalid_argument naming the value and its rule.
SimulatedCamera boardCamera(const estimation::Camera& camera, const vision::TagBoard& board,
                            const lie::SE3& X_CP, const SimulatedCameraConfig& config);
SimulatedCamera boardCamera(const estimation::Camera& camera, const vision::CharucoBoard& board,
                            const lie::SE3& X_CP, const SimulatedCameraConfig& config);

/// What such a camera renders: an arm of one section, out of sight.
inline const model::Twists kArmOutOfView = model::Twists::Identity(6, 1) * 0.4;

}  // namespace helix_arm::simulation
