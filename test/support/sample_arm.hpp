#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <string>

#include "helix_arm/model/arm.hpp"

namespace helix_arm::test {

constexpr double kSampleMaxPressure = 4e5;  // [Pa]

/// An arm of equal sections, each of `count` straight muscles on a circle: s1_m1, s1_m2, .., s2_m1,
/// ..
inline model::Arm sampleArm(int sections = 1, int count = 3) {
  const auto contraction = model::Contraction::table({0.0, kSampleMaxPressure}, {0.40, 0.30});
  std::vector<model::Section> parts(sections);
  for (int k = 0; k < sections; ++k) {
    for (int i = 0; i < count; ++i) {
      const double angle = 6.283185307179586 * i / count;
      const lie::SE3 X_O{Eigen::Matrix3d::Identity(),
                         0.03 * Eigen::Vector3d(0, std::cos(angle), std::sin(angle))};
      const std::string name = "s" + std::to_string(k + 1) + "_m" + std::to_string(i + 1);
      parts[k].actuators.push_back(
          {name, X_O, {10.0, 0.0, 1e-4}, contraction, {0.0, kSampleMaxPressure}});
    }
  }
  return model::Arm(std::move(parts));
}

}  // namespace helix_arm::test
