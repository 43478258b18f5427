#pragma once

#include "helix_arm/localization/placed_view.hpp"
#include "support/random.hpp"

namespace helix_arm::estimation {

/// A rig whose placements are off by what a PlacedView says of them.
inline ArmView misplaced(const PlacedView& placed, const model::Arm& arm, test::Random& random) {
  const auto draw = [&random](const lie::Vector6& deviations) {
    lie::Vector6 out;
    for (int i = 0; i < 6; ++i) out[i] = deviations[i] * random.normal();
    return out;
  };
  ArmView out = placed.view;
  out.X_CB = out.X_CB * lie::SE3::exp(draw(placed.deviations.base));
  for (std::size_t i = 0; i < out.layout.tags.size(); ++i) {
    TagPlacement& tag = out.layout.tags[i];
    tag = movedBy(tag, draw(placed.deviations.tags[i]), arm.restLength(tag.section));
  }
  return out;
}

}  // namespace helix_arm::estimation
