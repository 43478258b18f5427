#pragma once

#include <vector>

#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/model/arm.hpp"

namespace helix_arm::procedures {

/// Where one tag is mounted, in the measures of the arm at rest as if its skin were unrolled: along
/// the section, around it and outwards. All angles grow from the y axis of the base curve's frame
/// towards its z axis; the first muscle of a ring is at 0.
struct UnrolledTag {
  int id;
  int section;       ///< index, counted from 0 at the base
  double s;          ///< in [0, 1] along the section
  double from_base;  ///< from the base of the section, along its base curve [m]
  int actuator;      ///< index in the arm of the section's actuator that is nearest
  double angle;      ///< around the base curve, in [0, 2 pi) [rad]
  double radius;     ///< from the base curve to the tag's centre [m]
  double standoff;   ///< from the centre line of the actuator to the tag's centre, outwards [m]
  double aside;      ///< the same around the arm, towards larger angles [m]
  /// Direction of the tag's upper edge, seen from outside with the base on the left: 0 upwards,
  /// which is towards smaller angles; counter-clockwise, in (-pi, pi] [rad].
  double turn;
  double tilt;  ///< of the face from outwards, in [0, pi] [rad]
};

/// All tags, in their order.
/// @param layout  valid for this arm.
std::vector<UnrolledTag> unrolled(const model::Arm& arm, const estimation::TagLayout& layout);

/// Angle of an actuator around the base curve, in [0, 2 pi) [rad]; 0 at the centre.
double angleAround(const model::Actuator& actuator);

}  // namespace helix_arm::procedures
