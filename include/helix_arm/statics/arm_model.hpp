#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/load.hpp"
#include "helix_arm/statics/solution.hpp"
#include "helix_arm/statics/tier.hpp"

namespace helix_arm::statics {

/// The shape of one arm at given inputs, with the same interface for every tier.
///
/// Immutable. Solving stores no state, so threads may share a model. Copies are cheap.
class ArmModel {
 public:
  /// Chooses the tier automatically. @throws as chooseTier() and Load::validate() do.
  ArmModel(model::Arm arm, std::optional<model::PlanarArm> planar = std::nullopt,
           std::optional<Load> load = std::nullopt, const TierRequest& request = {});
  /// Uses a known tier setting, for example that of a slightly different arm. No tiers are
  /// compared, and choice() contains only this setting. @throws as chooseTier() does if the setting
  /// needs a load or a plane that the arm does not have.
  ArmModel(model::Arm arm, std::optional<model::PlanarArm> planar, std::optional<Load> load,
           const TierSetting& setting);

  const model::Arm& arm() const;
  const std::optional<model::PlanarArm>& planar() const;
  /// Absent if K_eps of the arm is unknown; empty (Load::empty()) if only K_eps is known.
  const std::optional<Load>& load() const;
  const TierChoice& choice() const;
  /// Whether no load is solved, and the arm is linear (ArmOf::isLinear()).
  bool isLinear() const;

  /// The same arm, load and tier, with these factors on every actuator's stiffness and K_eps.
  ArmModel scaledStiffness(const model::Stiffness& factors, double K_eps_factor = 1.0) const;
  /// The same arm and load with another tier. @throws as chooseTier() does.
  ArmModel withTier(const TierRequest& request) const;

  /// Shape at inputs q (n). Throws as Arm::lengths() does.
  Solution solve(const model::InputRef& q) const;
  /// Shape at given free lengths (n) [m], which are not checked.
  Solution solveLengths(const Eigen::VectorXd& lengths) const;
  /// Points of the base curve at inputs q (n), at `count` >= 2 evenly spaced s including base and
  /// tip. Every point is as accurate as the tip, whereas the shape of solve() is a helix between
  /// the ends of each piece. If no shape balances the load, the curve follows the shape of solve().
  /// @throws as Arm::lengths() does, and std::invalid_argument when count < 2.
  std::vector<model::CurvePoint<lie::SE3>> curve(const model::InputRef& q, int count) const;
  /// Pose of the tip at inputs q (n), without the shape. Throws as Arm::lengths() does. Does not
  /// allocate, except in the exact tier.
  Tip tip(const model::InputRef& q) const;
  /// The same at given free lengths (n) [m], which are not checked.
  Tip tipOfLengths(const Eigen::VectorXd& lengths) const;
  /// Tip and its Jacobian with respect to the free lengths, at given free lengths (n) [m], which
  /// are not checked. Multiply a column by the slope of that actuator's contraction curve to get
  /// the derivative with respect to its input. Accurate to 1e-6 under load.
  TipResponse tipResponse(const Eigen::VectorXd& lengths) const;

 private:
  struct Solvers;
  std::shared_ptr<const Solvers> solvers_;  // which copies share
};

/// Initial guess for a search for the true shape of the arm: the model's shape or, if the load was
/// not balanced, the shape without load, which is a better guess than the last iterate.
///
/// @param solution  solution of `model` at inputs q.
/// @param q  (n) inputs. Throws as Arm::lengths() does.
model::Shape startingShape(const ArmModel& model, const Solution& solution,
                           const model::InputRef& q);

}  // namespace helix_arm::statics
