#include "unrolled_tags.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

#include "basics/pi.hpp"

namespace helix_arm::procedures {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kAtCentre = 1e-9;  // below it, a point has no direction from the base curve [m]

// In [0, 2 pi). Rounding just below 0 would otherwise appear almost a whole turn away.
double positiveAngle(const Vector2d& yz) {
  constexpr double kRounding = 1e-9;
  const double angle = std::atan2(yz.y(), yz.x());
  if (angle > -kRounding) return std::max(angle, 0.0);
  return angle + 2 * basics::kPi;
}

int nearestActuator(const model::Arm& arm, int section, double s, const Vector3d& point) {
  int nearest = arm.firstActuator(section);
  const auto distance = [&](int i) {
    return (model::poseAlong(arm.actuator(i), s).translation - point).tail<2>().norm();
  };
  for (int i = nearest; i < arm.firstActuator(section + 1); ++i) {
    if (distance(i) < distance(nearest)) nearest = i;
  }
  return nearest;
}

// Direction from the base curve to a point, in the cross-section.
Vector2d outwardsAt(const Vector2d& point, const Vector2d& otherwise) {
  if (point.norm() > kAtCentre) return point.normalized();
  return otherwise.norm() > kAtCentre ? Vector2d(otherwise.normalized())
                                      : Vector2d(Vector2d::UnitX());
}

UnrolledTag unroll(const model::Arm& arm, const estimation::TagPlacement& tag) {
  const Vector3d& centre = tag.X_ST.translation;
  const Vector3d up = tag.X_ST.rotation.col(1), face = tag.X_ST.rotation.col(2);
  const Vector2d outwards = outwardsAt(centre.tail<2>(), face.tail<2>());
  const Vector2d around(-outwards.y(), outwards.x());

  UnrolledTag out{};
  out.id = tag.id;
  out.section = tag.section;
  out.s = tag.s;
  out.from_base = tag.s * arm.restLength(tag.section) + centre.x();
  out.actuator = nearestActuator(arm, tag.section, tag.s, centre);
  out.angle = positiveAngle(outwards);
  out.radius = centre.tail<2>().norm();
  const Vector2d muscle = model::poseAlong(arm.actuator(out.actuator), tag.s).translation.tail<2>();
  const Vector2d muscle_outwards = outwardsAt(muscle, outwards);
  const Vector2d from_muscle = centre.tail<2>() - muscle;
  out.standoff = from_muscle.dot(muscle_outwards);
  out.aside = muscle_outwards.x() * from_muscle.y() - muscle_outwards.y() * from_muscle.x();
  // On the page, s runs to the right and the angle downwards.
  out.turn = std::atan2(-up.x(), -up.tail<2>().dot(around));
  out.tilt = std::acos(std::clamp(face.tail<2>().dot(outwards), -1.0, 1.0));
  return out;
}

}  // namespace

std::vector<UnrolledTag> unrolled(const model::Arm& arm, const estimation::TagLayout& layout) {
  std::vector<UnrolledTag> tags;
  for (const estimation::TagPlacement& tag : layout.tags) tags.push_back(unroll(arm, tag));
  return tags;
}

double angleAround(const model::Actuator& actuator) {
  return positiveAngle(outwardsAt(actuator.X_O.translation.tail<2>(), Vector2d::Zero()));
}

}  // namespace helix_arm::procedures
