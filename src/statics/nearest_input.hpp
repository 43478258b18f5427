#pragma once

#include <algorithm>

#include "helix_arm/model/actuator.hpp"

namespace helix_arm::statics {

/// The input that gives an actuator a free length, within its limits.
struct NearestInput {
  double q;
  bool inside;  ///< whether that length is the given one, not that of a limit
};

/// @param length  [m], any.
template <class Group>
NearestInput nearestInput(const model::ActuatorOf<Group>& actuator, double length) {
  const model::Contraction& contraction = actuator.contraction;
  const double one = contraction.lengthInside(actuator.limits.lower);
  const double other = contraction.lengthInside(actuator.limits.upper);
  const double nearest = std::clamp(length, std::min(one, other), std::max(one, other));
  const double middle = 0.5 * (actuator.limits.lower + actuator.limits.upper);
  return {contraction.inverseInside(nearest, middle), nearest == length};
}

}  // namespace helix_arm::statics
