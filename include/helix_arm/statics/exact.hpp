#pragma once

#include <memory>
#include <vector>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/load.hpp"
#include "helix_arm/statics/solution.hpp"
#include "helix_arm/statics/unloaded_change.hpp"

namespace helix_arm::statics {

/// When the exact solution is exact enough.
struct ExactOptions {
  double tolerance = 1e-11;    ///< integration tolerance, relative to the arm's size and one radian
  int max_iterations = 200;    ///< Newton iterations, summed over all load steps
  int pieces_per_section = 8;  ///< pieces per section of the returned shape, >= 1

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// Statics of a loaded arm by shooting: the reference for the accuracy of the other tiers.
///
/// The strain follows from the wrench W that the part of the arm beyond s exerts, seen from the
/// base:
///   g(s) = g* + C Ad_X(s)^T W(s),  X' = X g,  dW/ds = -(wrench of the load per unit s),
/// where g* is the twist of the section without load (eq. 17) and C = (l / K_eps) A+ is its
/// compliance; in a tapered section both depend on s. The force is known in closed form. Newton's
/// method, with the derivative of the flow, finds the three components of the base moment for which
/// the moment at the tip equals the applied one. The integrator is an adaptive Runge-Kutta method
/// of order 8. Where errors would grow along the arm (long, and soft for its load), multiple
/// shooting is used: frames and moments at intermediate points are unknowns as well. If Newton's
/// method does not contract at once, the load is applied in steps. Of several equilibria, this
/// finds the stable one that grows from the unloaded shape. Where that branch ends (a snap, or a
/// column that is straight to the last digit under Euler's load), the result is whichever stable
/// equilibrium damped steps then find, with the status kSnapped. Point moments, which keep their
/// direction, have no energy: under them stability is not judged, and a shape that damped steps
/// find counts as converged although it may lie on another branch.
class ExactArm {
 public:
  /// @throws std::invalid_argument naming the value that breaks a rule of Load or ExactOptions.
  ExactArm(const model::Arm& arm, const Load& load, const ExactOptions& options = {});

  /// @param unloaded  twists (6 x sections) of the arm without load, or ArmOf::unloaded() of a
  /// tapered
  ///     arm.
  /// @return the shape; its residual is the last Newton step, relative to the arm's size and one
  ///     radian. If no shape is found: the shape that balances the largest fraction of the load
  ///     that was reached, with the Newton step towards the full load as residual.
  /// @throws std::invalid_argument on a wrong number of sections or twists that are not finite.
  Solution solve(const model::Unloaded& unloaded) const;

  /// Shape and its derivatives with respect to the parameters of `change`, then, on request, to a
  /// force (3) [1/N] and a moment (3) [1/(N m)] at the tip that keep their directions, base frame.
  /// They solve the linear differential equations about the shape, on Gauss points.
  /// @throws as solve() does.
  ShapeResponse differentiate(const model::Unloaded& unloaded,
                              const UnloadedChange<lie::SE3>& change, bool by_load = true) const;

  /// Points of the base curve at `count` >= 2 evenly spaced s, including base and tip. Each point
  /// is integrated like the tip, whereas the pieces of solve() are helices between their ends. If
  /// no shape is found, the points lie on those pieces.
  /// @throws as solve() does, and std::invalid_argument when count < 2.
  std::vector<model::CurvePoint<lie::SE3>> curve(const model::Unloaded& unloaded, int count) const;

 private:
  class Statics;
  std::shared_ptr<const Statics> statics_;  // immutable, so that copies and threads share it
};

}  // namespace helix_arm::statics
