#pragma once

#include <memory>
#include <string>

#include "ros_bridge/common/run_node.hpp"

namespace helix_arm::ros_bridge {

/// Makes the node of a program. @throws as the functions of run_node.hpp.
std::unique_ptr<Node> makeNode(const std::string& program);

}  // namespace helix_arm::ros_bridge
