#pragma once

#include <memory>
#include <vector>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/load.hpp"
#include "helix_arm/statics/solution.hpp"

namespace helix_arm::statics {

struct ExactOptions {
  double tolerance = 1e-11;    ///< of the integration, relative to the arm's size and one radian
  int max_iterations = 200;    ///< of Newton's method, all load steps together
  int pieces_per_section = 8;  ///< of the shape that is given, >= 1

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// Statics of a loaded arm by shooting: the reference that the other tiers are measured against.
///
/// The strain follows from the wrench that the arm beyond s exerts, seen from the base:
///   g(s) = g* + C Ad_X(s)^T W(s),  X' = X g,  dW/ds = -(wrench of the load per unit s),
/// with g* the twist of the section without load (eq. 17) and C = (l / K_eps) A+ its compliance.
/// The force is known in closed form; Newton's method, with the derivative of the flow, finds the
/// three components of the moment at the base that leave the tip with the moment that loads it.
/// Adaptive Runge-Kutta steps of order 8. Where errors would grow along the arm (long and soft for
/// its load), it is shot at from several places at once, whose frames and moments are unknowns too.
/// Load in steps where Newton's method does not contract at once: of several equilibria the stable
/// one that grows from the unloaded shape. Where that one ends (a snap, or a column that is
/// straight to the last digit under Euler's load), whichever balanced one damped steps then find,
/// be it unstable.
class ExactArm {
 public:
  /// @throws std::invalid_argument naming what breaks a rule of Load or ExactOptions.
  ExactArm(const model::Arm& arm, const Load& load, const ExactOptions& options = {});

  /// @param unloaded  twists (6 x sections) of the arm without load.
  /// @return  with a residual of the last Newton step, relative to the arm's size and one radian.
  /// Where no shape is found: the one that balances the largest part of the load that was reached,
  /// and the Newton step towards the whole load as residual.
  /// @throws std::invalid_argument on another number of sections or twists that are not finite.
  Solution solve(const model::Twists& unloaded) const;

  /// The curve at `count` >= 2 evenly spaced s, base and tip included, each point integrated as the
  /// tip is: not that of solve()'s pieces, which are helices from one end to the next. Where no
  /// shape is found, that of the pieces.
  /// @throws as solve() does, and std::invalid_argument when count < 2.
  std::vector<model::CurvePoint<lie::SE3>> curve(const model::Twists& unloaded, int count) const;

 private:
  class Statics;
  std::shared_ptr<const Statics> statics_;  // immutable, so that copies and threads share it
};

}  // namespace helix_arm::statics
