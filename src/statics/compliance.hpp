#pragma once

#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/load.hpp"

namespace helix_arm::statics {

/// Compliance C = (l / K_eps) A+ of section k: the twist per wrench, both seen from the section's
/// frame.
template <class Group>
typename Group::Matrix complianceOf(const model::ArmOf<Group>& arm, const Load& load, int k) {
  return arm.freeLength(k) / load.K_eps[k] * arm.equilibrium(k).compliance;
}

}  // namespace helix_arm::statics
