#pragma once

#include "support/loaded_arm.hpp"

namespace helix_arm::test {

/// A ring whose radius and tilt go from one value to another, with these values evenly spaced.
inline model::Section taperedSection(const Ring& ring, const std::vector<double>& radii,
                                     const std::vector<double>& tilts) {
  model::Section section = ringSection(ring, fig3Muscle());
  for (int i = 0; i < ring.count; ++i) {
    for (std::size_t j = 0; j < radii.size(); ++j) {
      section.actuators[i].taper.push_back(ringPose(i, ring.count, radii[j], tilts[j]));
    }
    section.actuators[i].X_O = section.actuators[i].taper.front();
  }
  return section;
}

/// Three muscles 50 mm from the curve at the base and 25 mm at the tip.
inline model::Arm taperedArm(double tilt = 0.0, double from = 0.05, double to = 0.025) {
  Ring ring = tilt == 0.0 ? straightRing() : helicalRing();
  if (tilt != 0.0) ring.stiffness.gamma = 100.0;
  return model::Arm({taperedSection(ring, {from, to}, {tilt, tilt})});
}

/// Two muscles in their plane, 50 mm from the curve at the base and 25 mm at the tip.
inline model::PlanarArm taperedPlanarArm(int sections = 1) {
  model::PlanarSection section = planarSection(0.05);
  for (auto& muscle : section.actuators) {
    muscle.taper = {muscle.X_O, {muscle.X_O.rotation, 0.5 * muscle.X_O.translation}};
  }
  return model::PlanarArm(std::vector<model::PlanarSection>(sections, section));
}

}  // namespace helix_arm::test
