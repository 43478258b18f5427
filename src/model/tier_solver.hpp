#pragma once

#include <optional>
#include <vector>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/model/exact.hpp"
#include "helix_arm/model/load.hpp"
#include "helix_arm/model/loaded.hpp"
#include "helix_arm/model/solution.hpp"
#include "helix_arm/model/tier.hpp"

namespace helix_arm::model {

/// One tier of one arm. Keeps references to the arms, which must outlive it.
class TierSolver {
 public:
  TierSolver(const Arm& arm, const std::optional<PlanarArm>& planar,
             const std::optional<Load>& load, const TierSetting& setting);

  /// Shape at free lengths (n) [m], or at inputs (n). Inputs throw as Arm::lengths() does.
  Solution solve(const Eigen::VectorXd& lengths) const;
  Solution solveInputs(const InputRef& q) const;
  /// The same without the shape.
  Tip tip(const Eigen::VectorXd& lengths) const;
  Tip tipOfInputs(const InputRef& q) const;
  std::vector<CurvePoint<lie::SE3>> curve(const InputRef& q, int count) const;
  TipResponse tipResponse(const Eigen::VectorXd& lengths) const;

 private:
  // Of what gives the twists without load of either arm.
  template <class Unloaded>
  Solution solveFrom(const Unloaded& unloaded) const;
  template <class Unloaded>
  Tip tipFrom(const Unloaded& unloaded) const;

  const Arm& arm_;
  const PlanarArm* plane_;  // where the arm is solved in its plane
  std::optional<LoadedArm> loaded_;
  std::optional<PlanarLoadedArm> planar_loaded_;
  std::optional<ExactArm> exact_;
};

}  // namespace helix_arm::model
