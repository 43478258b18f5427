#pragma once

#include "helix_arm/statics/load.hpp"
#include "support/paper_arm.hpp"

namespace helix_arm::test {

constexpr double kGravity = 9.81;  // [m/s^2]

/// The helical arm of 50.8 mm with the shear stiffness at which loads bend it most (MODEL.md,
/// section 2, erratum 3).
inline model::Arm softHelicalArm() {
  Ring ring = helicalRing();
  ring.stiffness.gamma = 10.0;
  return ringArm(ring);
}

/// Two muscles in their plane, so far from the curve.
inline model::PlanarSection planarSection(double offset) {
  model::PlanarSection section;
  for (const double y : {offset, -offset}) {
    const model::Contraction muscle = fig3Muscle();
    section.actuators.push_back({y > 0 ? "left" : "right",
                                 {Eigen::Matrix2d::Identity(), {0, y}},
                                 {10, 0, 1.4e-4},
                                 muscle,
                                 muscle.inputRange()});
  }
  return section;
}

/// Equal sections of two muscles 76.2 mm apart, in their plane.
inline model::PlanarArm planarArm(int sections = 1) {
  return model::PlanarArm(std::vector<model::PlanarSection>(sections, planarSection(0.0381)));
}

enum class Posture { kHanging, kHorizontal };

/// The weight of sections of this mass each.
inline statics::Load evenLoad(int sections, const Eigen::Vector3d& gravity, double mass,
                              double K_eps) {
  statics::Load load;
  load.gravity = gravity;
  load.mass.assign(static_cast<std::size_t>(sections), mass);
  load.K_eps.assign(static_cast<std::size_t>(sections), K_eps);
  return load;
}
/// K_eps without weight.
inline statics::Load weightless(int sections, double K_eps) {
  return evenLoad(sections, Eigen::Vector3d::Zero(), 0.0, K_eps);
}
/// Of an arm of one section.
inline statics::Load weight(Posture posture, double mass, double K_eps) {
  return posture == Posture::kHanging ? evenLoad(1, {kGravity, 0, 0}, mass, K_eps)
                                      : evenLoad(1, {0, 0, -kGravity}, mass, K_eps);
}

/// An arm that stands out horizontally under its weight and one at the tip.
inline statics::Load horizontalLoad(int sections = 1, double mass = 0.25, double K_eps = 1000.0) {
  statics::Load load = evenLoad(sections, {0, 0, -kGravity}, mass / sections, K_eps);
  load.points.push_back({sections - 1, 1.0, 0.2 * mass});
  return load;
}

/// One of the cases that the tiers are measured with (MODEL.md, section 4).
struct LoadedCase {
  statics::Load load;
  Eigen::VectorXd input;  // [Pa]
};

/// 3 masses of 0.15 to 0.3 kg, 3 K_eps of 500 to 1500 N, 5 pressures.
inline std::vector<LoadedCase> loadedCases(Posture posture) {
  const Eigen::Vector3d fractions[] = {
      {0, 0, 0}, {1, 0, 0}, {0.5, 0.5, 0}, {0.3, 0.6, 0.9}, {1, 1, 1}};
  std::vector<LoadedCase> out;
  for (const double mass : {0.15, 0.225, 0.3}) {
    for (const double K_eps : {500.0, 1000.0, 1500.0}) {
      for (const Eigen::Vector3d& fraction : fractions) {
        out.push_back({weight(posture, mass, K_eps), kMaxPressure * fraction});
      }
    }
  }
  return out;
}

/// Sections of random tilted rings under their weight, a tip load and a load somewhere on the way.
inline statics::Load randomLoad(int sections, Random& random) {
  statics::Load load;
  load.gravity = kGravity * random.direction<3>();
  for (int k = 0; k < sections; ++k) {
    load.mass.push_back(random.uniform(0.05, 0.15));
    load.K_eps.push_back(random.uniform(1000, 2000));
  }
  statics::PointLoad tip{sections - 1, 1.0, random.uniform(0, 0.03)};
  tip.force = random.uniform(0, 0.2) * random.direction<3>();
  tip.moment = random.uniform(0, 0.02) * random.direction<3>();
  tip.offset = random.uniform(0, 0.05) * random.direction<3>();
  statics::PointLoad inner;
  inner.section = random.integer(0, sections - 1);
  inner.s = random.uniform(0.2, 0.8);
  inner.mass = random.uniform(0, 0.05);
  inner.force = random.uniform(0, 0.2) * random.direction<3>();
  inner.offset = random.uniform(0, 0.05) * random.direction<3>();
  load.points = {tip, inner};
  return load;
}

}  // namespace helix_arm::test
