#pragma once

#include <optional>
#include <vector>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/load.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "helix_arm/statics/solution.hpp"
#include "helix_arm/statics/tier.hpp"

namespace helix_arm::statics {

/// One tier of one arm. Keeps references to the arms, which must outlive it.
class TierSolver {
 public:
  TierSolver(const model::Arm& arm, const std::optional<model::PlanarArm>& planar,
             const std::optional<Load>& load, const TierSetting& setting);

  /// Shape at free lengths (n) [m] or at inputs (n). The functions of inputs throw as
  /// Arm::lengths() does.
  Solution solve(const Eigen::VectorXd& lengths) const;
  Solution solveInputs(const model::InputRef& q) const;
  /// The same without the shape.
  Tip tip(const Eigen::VectorXd& lengths) const;
  Tip tipOfInputs(const model::InputRef& q) const;
  std::vector<model::CurvePoint<lie::SE3>> curve(const model::InputRef& q, int count) const;
  TipResponse tipResponse(const Eigen::VectorXd& lengths) const;

 private:
  // Solve from a function that returns the unloaded twists of either arm.
  template <class Unloaded>
  Solution solveFrom(const Unloaded& unloaded) const;
  // `direct` gives the tip of either arm without load.
  template <class Unloaded, class Direct>
  Tip tipFrom(const Unloaded& unloaded, const Direct& direct) const;
  template <class Group>
  model::UnloadedOf<Group> unloadedAt(const model::ArmOf<Group>& arm,
                                      const model::InputRef& q) const;
  template <class Group>
  model::UnloadedOf<Group> unloadedOfLengths(const model::ArmOf<Group>& arm,
                                             const Eigen::VectorXd& lengths) const;
  model::Shape embeddedShape(const model::UnloadedOf<lie::SE2>& unloaded) const;

  const model::Arm& arm_;
  const model::PlanarArm* plane_;  // set if the arm is solved in its plane
  const Load* load_;               // null if the tier takes none
  bool differs_;  // whether differences of constant twists are the fastest response of the tip
  std::optional<LoadedArm> loaded_;
  std::optional<PlanarLoadedArm> planar_loaded_;
  std::optional<ExactArm> exact_;
};

}  // namespace helix_arm::statics
