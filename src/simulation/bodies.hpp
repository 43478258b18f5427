#pragma once

#include <random>
#include <vector>

#include "helix_arm/localization/body_check.hpp"
#include "helix_arm/simulation/config.hpp"

namespace helix_arm::simulation {

/// A motion-capture system that sees the bodies of a simulated arm, with the noise that each of
/// them states. The same seed and calls give the same poses.
class SimulatedBodies {
 public:
  /// @param truth  the true view of the bodies.
  SimulatedBodies(const estimation::ArmView& truth, const SimulatedBodiesConfig& config);

  /// Poses at one time of an arm of this shape, seen from the frame C of the view; lost ones are
  /// missing. A body without rotation noise has the identity for its rotation.
  std::vector<estimation::BodyPose> see(const model::Shape& shape);

 private:
  estimation::ArmView truth_;
  SimulatedBodiesConfig config_;
  std::mt19937_64 generator_;
  std::normal_distribution<double> normal_;
  std::uniform_real_distribution<double> uniform_;
};

}  // namespace helix_arm::simulation
