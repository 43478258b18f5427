#pragma once

#include "helix_arm/statics/load.hpp"

namespace helix_arm::test {

/// Gravity across an arm that stands out horizontally, its x axis along the tangent at the base,
/// and a weight at the tip.
inline statics::Load horizontalLoad(int sections = 1, double mass = 0.25, double K_eps = 1000.0) {
  statics::Load load;
  load.gravity = {0, 0, -9.81};
  load.mass.assign(sections, mass / sections);
  load.K_eps.assign(sections, K_eps);
  statics::PointLoad tip;
  tip.section = sections - 1;
  tip.mass = 0.2 * mass;
  load.points.push_back(tip);
  return load;
}

}  // namespace helix_arm::test
