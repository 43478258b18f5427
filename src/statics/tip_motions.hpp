#pragma once

#include "helix_arm/model/arm.hpp"

namespace helix_arm::statics {

/// Body motion of the tip with respect to the free length of each actuator, without load. Calls
/// take(i, motion) for every actuator i, motion (dof) [m/m; rad/m].
/// @param twists  (dof x sections).
template <class Group, class Take>
void forTipMotions(const model::ArmOf<Group>& arm, const model::TwistsOf<Group>& twists,
                   const Take& take) {
  // A change of section k's twist moves the tip by Ad(X_link,k X_{k+1} .. X_n)^-1 Jr(g_k).
  Group after;
  const auto& links = arm.links();
  for (int k = arm.sectionCount() - 1; k >= 0; --k) {
    if (links) after = (*links)[k] * after;
    const typename Group::Matrix body =
        after.inverse().adjoint() * Group::rightJacobian(twists.col(k));
    const auto& map = arm.equilibrium(k).map;
    for (int i = 0; i < map.cols(); ++i) {
      take(arm.firstActuator(k) + i, typename Group::Tangent(body * map.col(i)));
    }
    after = Group::exp(twists.col(k)) * after;
  }
}

}  // namespace helix_arm::statics
