#include "rod.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "compliance.hpp"

namespace helix_arm::statics {
namespace {

using Eigen::Vector3d;

constexpr double kGrowth = 2.5;          // e-fold growth of errors that a segment may have
constexpr int kMaxSegments = 64;         // per section
constexpr double kMostGrowth = 50.0;     // per segment that is counted
constexpr double kLeastMoment = 1e-300;  // unit of moments on an arm without load [N m]

}  // namespace

Rod::Rod(const model::Arm& arm, const Load& given, double tolerance)
    : tolerance_(tolerance), links_(arm.links()) {
  const Load load = given.atEnds(links_.get());
  const int sections = arm.sectionCount();
  double bend = 0.0;
  for (int k = 0; k < sections; ++k) {
    const double l = arm.freeLength(k);
    laws_.push_back({complianceOf(arm, load, k), arm.equilibrium(k).null_space});
    size_ += l;
    bend += laws_[k].C.bottomRightCorner<3, 3>().norm();
    force_scale_ += load.mass[k] * load.gravity.norm();
  }
  std::vector<PointLoad> points = load.points;
  std::stable_sort(points.begin(), points.end(), [](const PointLoad& a, const PointLoad& b) {
    return a.section + a.s < b.section + b.s;
  });
  for (const PointLoad& point : points) {
    force_scale_ += load.forceOf(point).norm();
    conservative_ = conservative_ && point.moment.isZero(0);
    moment_scale_ += load.forceOf(point).norm() * point.offset.norm() + point.moment.norm();
  }
  moment_scale_ += force_scale_ * size_;
  moment_unit_ = bend > 0 ? 1.0 / bend : std::max(moment_scale_, kLeastMoment);

  // From the tip to the base, since a force acts on everything before it.
  Vector3d force = Vector3d::Zero();
  std::vector<Segment> backward;
  for (int k = sections - 1; k >= 0; --k) {
    const Vector3d weight = load.mass[k] * load.gravity;
    const double c = laws_[k].C.bottomRightCorner<3, 3>().norm(), l = arm.freeLength(k);
    double end = 1.0;
    while (end > 0) {
      std::vector<Pull> pulls;
      while (!points.empty() && points.back().section + points.back().s >= k + end) {
        const PointLoad& point = points.back();
        pulls.push_back({point.offset, load.forceOf(point), point.moment});
        force += pulls.back().force;
        points.pop_back();
      }
      const double begin = !points.empty() && points.back().section == k ? points.back().s : 0.0;
      const double largest = std::max(force.norm(), (force + (end - begin) * weight).norm());
      const double growth = std::sqrt(c * l * largest) * (end - begin);
      const int parts =
          static_cast<int>(std::clamp(std::ceil(growth / kGrowth), 1.0, 1.0 * kMaxSegments));
      for (int i = parts; i > 0; --i) {
        const auto at = [&](int part) {
          return part == parts ? end : begin + (end - begin) * part / parts;
        };
        backward.push_back({k, at(i - 1), at(i), force, weight, std::move(pulls),
                            std::min(growth / parts, kMostGrowth)});
        pulls.clear();
        force += (at(i) - at(i - 1)) * weight;
      }
      end = begin;
    }
  }
  segments_.assign(std::make_move_iterator(backward.rbegin()),
                   std::make_move_iterator(backward.rend()));
}

}  // namespace helix_arm::statics
