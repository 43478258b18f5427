#pragma once

#include <string>

#include "helix_arm/basics/pi.hpp"
#include "helix_arm/dynamics/arm_motion.hpp"
#include "support/loaded_arm.hpp"

namespace helix_arm::test {

/// `simulation.arm.dynamics` with which an arm swings at a frequency [Hz] with a damping ratio, at
/// a third of its pressures.
inline std::string swinging(const model::Arm& arm, double frequency, double damping) {
  constexpr double kStiffness = 60;  // [N]
  statics::Load load =
      evenLoad(arm.sectionCount(), Eigen::Vector3d::Zero(), 1.0 / arm.sectionCount(), kStiffness);
  const dynamics::ArmMotion motion(arm, std::nullopt, load, {});
  const double of_a_kilogram =
      dynamics::vibrationsOf(motion.linearisedAt(arm.inputAt(1.0 / 3))).front().frequency;
  const double mass = of_a_kilogram * of_a_kilogram / (frequency * frequency);
  const std::string time = std::to_string(damping / (basics::kPi * frequency));
  return "{mass_kg: " + std::to_string(mass) + ", K_eps_n: " + std::to_string(kStiffness) +
         ", damping_s: {stretch: " + time + ", shear: " + time + ", twist: " + time +
         ", bend: " + time + "}}";
}

}  // namespace helix_arm::test
