#pragma once

#include "support/loaded_arm.hpp"

namespace helix_arm::test {

/// Lengths of the plates of linkedArm() and linkedPlanarArm() [m].
inline constexpr double kPlates[] = {0.03, 0.012};

/// The tool of linkedArm(): beside the axis and turned.
inline lie::SE3 tool() {
  return {(Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitZ()) *
           Eigen::AngleAxisd(-0.7, Eigen::Vector3d::UnitX()))
              .toRotationMatrix(),
          {0.06, -0.015, 0.02}};
}

/// Two helical sections with plates, and a tool.
inline model::Arm linkedArm() {
  std::vector<model::Section> sections(2, ringSection(helicalRing(), fig3Muscle()));
  for (int k = 0; k < 2; ++k) sections[k].plate = kPlates[k];
  return model::Arm(std::move(sections), tool());
}

/// The same of planarArm(), with a tool in the plane.
inline model::PlanarArm linkedPlanarArm() {
  const model::PlanarArm plain = planarArm();
  std::vector<model::PlanarSection> sections(2);
  for (int k = 0; k < 2; ++k) {
    for (int i = 0; i < 2; ++i) sections[k].actuators.push_back(plain.actuator(i));
    sections[k].plate = kPlates[k];
  }
  return model::PlanarArm(std::move(sections),
                          {Eigen::Rotation2Dd(0.4).toRotationMatrix(), {0.06, -0.015}});
}

}  // namespace helix_arm::test
