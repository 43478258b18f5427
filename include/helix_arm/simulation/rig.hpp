#pragma once

#include <Eigen/Core>
#include <optional>

#include <opencv2/core.hpp>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"
#include "helix_arm/simulation/camera.hpp"

namespace helix_arm::simulation {

/// How the true arm differs from the arm of its scene, as real ones do.
struct ArmDeviation {
  double K_gamma_scale = 1.0;  ///< > 0
  double K_kappa_scale = 1.0;  ///< > 0
  double length_scale = 1.0;   ///< of the free lengths, > 0

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// An arm that is not quite what its scene says.
class TrueArm {
 public:
  TrueArm(const model::Arm& arm, const ArmDeviation& deviation);

  const model::Arm& arm() const { return arm_; }
  /// Twists (6 x sections) at gauge pressures (n) [Pa], clamped to the limits.
  model::Twists twists(const model::InputRef& pressure) const;

 private:
  model::Arm arm_;
  double length_scale_;
};

}  // namespace helix_arm::simulation
