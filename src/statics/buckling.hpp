#pragma once

#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/load.hpp"

namespace helix_arm::statics {

/// How large a load is against the least one that buckles the arm, from above and whatever the
/// arm's shape: below 1 nothing buckles.
///
/// A motion turns the frame at s by theta(s), theta(0) = 0. The forces free at most the integral of
/// |F| |theta|^2 / 2, and what moments and levers turn adds to it, while |theta(s)|^2 is at most
/// twice the energy of bending times the compliance before s. Shear counts as in Engesser's column.
template <class Group>
double bucklingBound(const model::ArmOf<Group>& arm, const Load& load);

}  // namespace helix_arm::statics
