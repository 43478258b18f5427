// Arms and loads that several tests of the tiers take.
#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "helix_arm/statics/arm_model.hpp"
#include "support/apart.hpp"
#include "support/linked_arm.hpp"
#include "support/tapered_arm.hpp"

namespace helix_arm::statics {

using test::apart;
using test::weightless;

inline TierRequest request(Tier tier, std::optional<int> order = {}) {
  TierRequest out;
  out.tier = tier;
  out.order = order;
  return out;
}

/// Tilted rings of a random number of muscles between two, and K_tau from a least one.
inline model::Arm randomRings(int sections, std::pair<int, int> muscles, double K_tau,
                              test::Random& random) {
  std::vector<model::Section> parts;
  for (int k = 0; k < sections; ++k) {
    test::Ring ring;
    ring.count = random.integer(muscles.first, muscles.second);
    ring.radius = random.uniform(0.02, 0.05);
    ring.tilt = random.uniform(-0.3, 0.3);
    ring.stiffness = {random.logUniform(10, 100), random.uniform(K_tau, 1e-4),
                      random.uniform(1e-4, 2e-4)};
    parts.push_back(test::ringSection(ring, test::fig3Muscle()));
  }
  return model::Arm(std::move(parts));
}

/// Of two sections: their weight, a force at the end of the last link, and a mass where the second
/// section begins.
inline Load loadOfLinks(const model::Arm& arm, const Eigen::Vector3d& gravity,
                        const Eigen::Vector3d& force) {
  Load load = weightless(2, 900);
  load.gravity = gravity;
  load.mass = {0.1, 0.08};
  load.points = {{1, 1.0, 0.0, force, {0, 0, 0}, arm.link(1).translation},
                 {1, 0.0, 0.03, {0, 0, 0}, {0, 0, 0}, {0, 0.02, 0}}};
  return load;
}
inline Load spatialLoad(const model::Arm& arm) {
  return loadOfLinks(arm, {5, 0, -8}, {0.05, 0.1, -0.08});
}

/// Muscles that are softest at a third of the pressure, as of latex, times a factor that keeps them
/// from buckling.
inline const StiffnessTable kTable{{0, 1e5, 2e5, test::kMaxPressure},
                                   {45 / 14., 1, 37 / 14., 52 / 14.}};

inline Load loadWith(const std::optional<StiffnessTable>& table, double K_eps = 300,
                     double mass = 0.1) {
  Load load = test::weight(test::Posture::kHorizontal, mass, K_eps);
  if (table) load.tables = {*table};
  return load;
}

inline constexpr double kTilt = 15 * test::kPi / 180;

/// Two tapered sections of which one changes its slope, and a plate.
inline model::Arm twoTaperedSections() {
  model::Section lower =
      test::taperedSection(test::helicalRing(), {0.05, 0.04, 0.025}, {0.0, kTilt, kTilt});
  lower.plate = 0.01;
  return model::Arm(
      {lower, test::taperedSection(test::helicalRing(), {0.025, 0.02}, {kTilt, 0.0})});
}

}  // namespace helix_arm::statics
