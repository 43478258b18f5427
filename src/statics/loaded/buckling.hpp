#pragma once

#include <Eigen/Core>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/load.hpp"

namespace helix_arm::statics {

/// Compliance C = (l / K_eps) A+ of section k: the twist per wrench, in the section's frame.
template <class Group>
typename Group::Matrix complianceOf(const model::ArmOf<Group>& arm, const Load& load, int k) {
  return arm.freeLength(k) / load.K_eps[k] * arm.equilibrium(k).compliance;
}

/// Upper bound of the ratio of a load to the smallest load that buckles the arm, for any shape of
/// the arm. If it is below 1, nothing buckles.
///
/// A motion rotates the frame at s by theta(s), theta(0) = 0. The energy that the forces release is
/// at most the integral of |F| |theta|^2 / 2, and what moments and lever arms add; |theta(s)|^2 is
/// at most twice the bending energy times the compliance before s. Shear as in Engesser's column.
template <class Group>
double bucklingBound(const model::ArmOf<Group>& arm, const Load& load);

}  // namespace helix_arm::statics
