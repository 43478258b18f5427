#pragma once

#include <Eigen/Geometry>
#include <string>

#include "basics/pi.hpp"
#include "helix_arm/model/arm.hpp"
#include "support/random.hpp"

namespace helix_arm::test {

using basics::kPi;
inline constexpr double kPsi = 6894.757293168;     // [Pa]
inline constexpr double kMaxPressure = 60 * kPsi;  // [Pa]

/// The free length of the paper's Fig. 3 muscles; its coefficients are printed for psi.
inline model::Contraction fig3Muscle() {
  std::array<double, 6> c = {4.269760703e-1, -3.982361379e-4, -8.216242656e-5,
                             5.394266367e-7, 2.666729952e-8,  -3.002668523e-10};
  double power = 1.0;
  for (double& coefficient : c) {
    coefficient *= power;
    power *= 60.0;
  }
  return model::Contraction::quintic(c, kMaxPressure, kMaxPressure);
}

/// Muscle i of n on a circle, tilted (MODEL.md, section 1).
inline lie::SE3 ringPose(int i, int n, double radius, double tilt) {
  const double angle = 2 * kPi * i / n;
  const Eigen::Matrix3d R = (Eigen::AngleAxisd(angle - kPi / 2, Eigen::Vector3d::UnitX()) *
                             Eigen::AngleAxisd(-tilt, Eigen::Vector3d::UnitZ()))
                                .toRotationMatrix();
  return {R, radius * Eigen::Vector3d(0, std::cos(angle), std::sin(angle))};
}

struct Ring {
  int count = 3;
  double radius = 0.0254;  // [m]
  double tilt = 0.0;       // [rad]
  model::Stiffness stiffness{10.0, 0.0, 1.38e-4};
};

inline model::Section ringSection(const Ring& ring, const model::Contraction& contraction) {
  model::Section section;
  for (int i = 0; i < ring.count; ++i) {
    section.actuators.push_back({"muscle_" + std::to_string(i + 1),
                                 ringPose(i, ring.count, ring.radius, ring.tilt), ring.stiffness,
                                 contraction, contraction.inputRange()});
  }
  return section;
}

inline model::Arm ringArm(const Ring& ring, int sections = 1) {
  return model::Arm(std::vector<model::Section>(sections, ringSection(ring, fig3Muscle())));
}

inline Ring straightRing(int count = 3) { return {count, 0.0254, 0.0, {10.0, 0.0, 1.38e-4}}; }
inline Ring helicalRing(int count = 3) {
  return {count, 0.0254, 15 * kPi / 180, {100.0, 0.0, 9.8e-5}};
}

/// Inputs uniform within the limits.
inline Eigen::VectorXd randomInput(const model::Arm& arm, Random& random) {
  Eigen::VectorXd q(arm.actuatorCount());
  for (int i = 0; i < q.size(); ++i)
    q[i] = random.uniform(arm.actuator(i).limits.lower, arm.actuator(i).limits.upper);
  return q;
}

}  // namespace helix_arm::test
