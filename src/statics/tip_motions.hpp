#pragma once

#include "helix_arm/model/arm.hpp"

namespace helix_arm::statics {

/// Body motion of the tip with respect to the free length of each actuator, without load. Calls
/// take(i, motion) for every actuator i, motion (dof) [m/m; rad/m].
/// @param unloaded  state of the arm, which may be tapered.
template <class Group, class Take>
void forTipMotionsOfPieces(const model::ArmOf<Group>& arm, const model::UnloadedOf<Group>& unloaded,
                           const Take& take) {
  const model::PiecesOf<Group> pieces = arm.pieces(unloaded);
  const int per_section = arm.piecesPerSection();
  Group after;
  for (int k = arm.sectionCount() - 1; k >= 0; --k) {
    after = arm.link(k) * after;
    typename model::Equilibrium<Group>::Map motions = arm.equilibrium(k).map;
    motions.setZero();
    for (int j = per_section - 1; j >= 0; --j) {
      const typename Group::Tangent piece = pieces.col(k * per_section + j);
      const typename Group::Matrix body = after.inverse().adjoint() * Group::rightJacobian(piece);
      motions += body * arm.pieceByLengths(k, j, unloaded);
      after = Group::exp(piece) * after;
    }
    for (int i = 0; i < motions.cols(); ++i) {
      take(arm.firstActuator(k) + i, typename Group::Tangent(motions.col(i)));
    }
  }
}

/// The same for an arm without taper.
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
