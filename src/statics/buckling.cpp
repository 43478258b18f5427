#include "buckling.hpp"

#include <vector>

#include "compliance.hpp"

namespace helix_arm::statics {

template <class Group>
double bucklingBound(const model::ArmOf<Group>& arm, const Load& load) {
  const int sections = arm.sectionCount();
  std::vector<double> own;                                     // bending compliance of each section
  std::vector<double> bend(sections + 1), sway(sections + 1);  // of everything before a section
  double shear = 0.0, size = 0.0;
  for (int k = 0; k < sections; ++k) {
    const double l = arm.freeLength(k);
    const typename Group::Matrix compliance = complianceOf(arm, load, k);
    own.push_back(
        compliance.template bottomRightCorner<Group::kRotations, Group::kRotations>().norm());
    shear += compliance.template topLeftCorner<Group::kSpace, Group::kSpace>().norm();
    size += l;
    bend[k + 1] = bend[k] + own[k];
    sway[k + 1] = sway[k] + l * (bend[k] + 0.5 * own[k]);
    // A link turns with the end of its section.
    if (arm.links()) sway[k + 1] += arm.link(k).translation.norm() * bend[k + 1];
  }
  const auto byForce = [&](int k, double s) {
    return sway[k] + arm.freeLength(k) * s * (bend[k] + 0.5 * s * own[k]) + shear / size;
  };
  double bound = 0.0;
  for (int k = 0; k < sections; ++k) {
    // Simpson's rule is exact here.
    bound += load.mass[k] * load.gravity.norm() *
             (byForce(k, 0.0) + 4.0 * byForce(k, 0.5) + byForce(k, 1.0)) / 6.0;
  }
  for (const PointLoad& point : load.points) {
    const double force = load.forceOf(point).norm();
    const double bend_before = bend[point.section] + point.s * own[point.section];
    bound += force * byForce(point.section, point.s) +
             (force * point.offset.norm() + point.moment.norm()) * bend_before;
  }
  return bound;
}

template double bucklingBound(const model::ArmOf<lie::SE2>&, const Load&);
template double bucklingBound(const model::ArmOf<lie::SE3>&, const Load&);

}  // namespace helix_arm::statics
