#pragma once

#include <Eigen/Core>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/load.hpp"

namespace helix_arm::statics {

/// Whether the stiffness depends on the inputs themselves, of which free lengths do not tell:
/// K_kappa of the arm or K_eps of the load has StiffnessTables.
/// @param load  null without one.
template <class Group>
bool readsInputs(const model::ArmOf<Group>& arm, const Load* load) {
  return arm.hasTables() || (load != nullptr && !load->tables.empty());
}

/// The arm at given inputs (n), as the tiers that take a load need it: with the stiffness that its
/// actuators have at these inputs, if it readsInputs(). In each of the sections with tables
///   A(q) = sum k_i Ad_i^-T K_i Ad_i^-1,  D(q) = [k_i Ad_i^-T K_i e1],  g* = A(q)^-1 D(q) l,
/// where k_i is K_eps of actuator i relative to that of the section; K_i depends on q, too, if
/// K_kappa does.
template <class Group>
model::UnloadedOf<Group> unloadedUnder(const model::ArmOf<Group>& arm, const Load& load,
                                       const model::InputRef& q);

/// The same at free lengths (n) [m], which are not checked: each actuator is as stiff as at the
/// input that gives it that length. Beyond its limits it is as stiff as there.
template <class Group>
model::UnloadedOf<Group> unloadedUnderOfLengths(const model::ArmOf<Group>& arm, const Load& load,
                                                const Eigen::VectorXd& lengths);

/// @throws std::invalid_argument if a section with a StiffnessTable is tapered, has a motion that
/// no
///     actuator resists, or is so much stiffer against shear than against bending that A(q) is not
///     accurate.
template <class Group>
void requireTables(const model::ArmOf<Group>& arm, const Load& load);

}  // namespace helix_arm::statics
