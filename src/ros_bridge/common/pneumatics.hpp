#pragma once

#include "helix_arm/io/scene.hpp"

/// Requirements on scenes of nodes that use the arm's pressures.
namespace helix_arm::ros_bridge {

/// The scene, if all of its actuators are driven by pressure.
/// @throws std::invalid_argument naming the others.
io::Scene requirePneumatic(io::Scene scene);

}  // namespace helix_arm::ros_bridge
