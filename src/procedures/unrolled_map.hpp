#pragma once

#include <vector>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/procedures/printed_page.hpp"
#include "helix_arm/procedures/unrolled_tags.hpp"

namespace helix_arm::procedures {

/// Height of the drawing of addUnrolledMap() [mm].
inline constexpr double kMapHeight = 72.0;

/// Draws a section as if its skin were unrolled and seen from outside: its base on the left, angles
/// growing downwards, a line per actuator, a square per tag with its id and up mark.
/// @param tags  of this section, at least one.
/// @param box   kMapHeight high.
void addUnrolledMap(const model::Arm& arm, const std::vector<UnrolledTag>& tags, const Box& box,
                    Page& page);

}  // namespace helix_arm::procedures
