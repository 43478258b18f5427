#include "buckling.hpp"

#include <algorithm>
#include <vector>

namespace helix_arm::statics {
namespace {

constexpr int kTaperSamples = 64;

}  // namespace

template <class Group>
double bucklingBound(const model::ArmOf<Group>& arm, const Load& load) {
  const int sections = arm.sectionCount();
  std::vector<double> own;                                     // bending compliance of each section
  std::vector<double> bend(sections + 1), sway(sections + 1);  // of everything before a section
  double shear = 0.0, size = 0.0;
  for (int k = 0; k < sections; ++k) {
    const double l = arm.freeLength(k);
    double bending = 0.0, shearing = 0.0;
    const auto& taper = arm.taper(k);
    // A tapered section counts as if it were as soft as its softest part.
    for (int i = 0; i <= (taper ? kTaperSamples : 0); ++i) {
      const typename Group::Matrix compliance =
          taper
              ? typename Group::Matrix(l / load.K_eps[k] *
                                       taper->complianceAt(static_cast<double>(i) / kTaperSamples))
              : complianceOf(arm, load, k);
      bending = std::max(
          bending,
          compliance.template bottomRightCorner<Group::kRotations, Group::kRotations>().norm());
      shearing = std::max(shearing,
                          compliance.template topLeftCorner<Group::kSpace, Group::kSpace>().norm());
    }
    own.push_back(bending);
    shear += shearing;
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
