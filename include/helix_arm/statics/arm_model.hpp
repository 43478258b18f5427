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

/// One arm behind one interface, whatever the tier: inputs to shape.
///
/// Immutable; solving keeps nothing, so that threads may share it.
class ArmModel {
 public:
  /// Chooses the tier. @throws as chooseTier() and Load::validate() do.
  ArmModel(model::Arm arm, std::optional<model::PlanarArm> planar = std::nullopt,
           std::optional<Load> load = std::nullopt, const TierRequest& request = {});
  /// By a setting that is known, as of the same arm a little changed: nothing is compared, and the
  /// choice says no more than that. @throws as chooseTier() does where it needs a load or a plane
  /// that the arm has not.
  ArmModel(model::Arm arm, std::optional<model::PlanarArm> planar, std::optional<Load> load,
           const TierSetting& setting);
  ArmModel(const ArmModel& other);
  ArmModel(ArmModel&&) noexcept;
  ArmModel& operator=(ArmModel other) noexcept;
  ~ArmModel();

  const model::Arm& arm() const;
  const std::optional<model::PlanarArm>& planar() const;
  const std::optional<Load>& load() const;
  const TierChoice& choice() const;

  /// The same arm, load and tier with this stiffness of every actuator.
  ArmModel withStiffness(const model::Stiffness& stiffness) const;
  /// The same arm and load by another tier. @throws as chooseTier() does.
  ArmModel withTier(const TierRequest& request) const;

  /// Shape at inputs q (n). Throws as Arm::lengths() does.
  Solution solve(const model::InputRef& q) const;
  /// Shape at given free lengths (n) [m]; not checked.
  Solution solveLengths(const Eigen::VectorXd& lengths) const;
  /// The curve at inputs q (n), `count` >= 2 evenly spaced s, base and tip included: as good as the
  /// tip at every s, where solve()'s shape is a helix from one end of a piece to the next. Where no
  /// shape holds the load, the curve of what solve() gives.
  /// @throws as Arm::lengths() does, and std::invalid_argument when count < 2.
  std::vector<model::CurvePoint<lie::SE3>> curve(const model::InputRef& q, int count) const;
  /// Pose of the tip at inputs q (n), without the shape. Throws as Arm::lengths() does; does not
  /// allocate but in the exact tier.
  Tip tip(const model::InputRef& q) const;
  /// The same at given free lengths (n) [m]; not checked.
  Tip tipOfLengths(const Eigen::VectorXd& lengths) const;
  /// Tip and its Jacobian at given free lengths (n) [m]; not checked. Times the contraction's
  /// slope, a column is the change by that actuator's input. Good to 1e-6 under load.
  TipResponse tipResponse(const Eigen::VectorXd& lengths) const;

 private:
  class Solvers;
  explicit ArmModel(std::unique_ptr<Solvers> solvers);

  std::unique_ptr<Solvers> solvers_;
};

/// Where a search for the arm's true shape begins: the model's shape, or where its load found no
/// balance, the shape without load, which is a better guess than what the last iteration left.
///
/// @param solution  the model's, at inputs q.
/// @param q         (n) inputs. Throws as Arm::lengths() does.
model::Shape startingShape(const ArmModel& model, const Solution& solution,
                           const model::InputRef& q);

}  // namespace helix_arm::statics
