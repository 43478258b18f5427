#pragma once

#include "helix_arm/io/scene.hpp"

/// What every node that has to do with the arm's pressures asks of a scene.
namespace helix_arm::ros_bridge {

/// The scene, when total areas actuators are driven by pressure.
/// @throws std::invalid_argument naming those that are not.
io::Scene requirePneumatic(io::Scene scene);

}  // namespace helix_arm::ros_bridge
