#include "rod.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "helix_arm/statics/stiffness_by_input.hpp"
#include "statics/loaded/buckling.hpp"

namespace helix_arm::statics {
namespace {

using Eigen::Vector3d;

constexpr double kGrowth = 2.5;          // e-fold growth of errors that a segment may have
constexpr int kMaxSegments = 64;         // per section
constexpr double kMostGrowth = 50.0;     // per segment that is counted
constexpr int kSteps = 16;               // per cell of a taper
constexpr double kLeastMoment = 1e-300;  // unit of moments on an arm without load [N m]

// The last s below `end` at which the taper changes its slope; 0 without any.
double lastKnot(const SectionLaw& law, double end) {
  if (!law.taper) return 0.0;
  const int cells = law.taper->cells();
  int cell = static_cast<int>(std::ceil(end * cells)) - 1;
  if (static_cast<double>(cell) / cells >= end) --cell;
  return std::max(0.0, static_cast<double>(cell) / cells);
}

}  // namespace

std::optional<model::TaperTwist<lie::SE3>> Rod::profileOf(int section,
                                                          const model::Unloaded& unloaded) const {
  const SectionLaw& law = laws_[section];
  if (!law.taper) return std::nullopt;
  return model::TaperTwist<lie::SE3>(
      *law.taper, unloaded.lengths.segment(first_[section], first_[section + 1] - first_[section]));
}

lie::Matrix6 Rod::compliance(int section, double s, const model::Unloaded& unloaded) const {
  const SectionLaw& law = laws_[section];
  return law.taper ? lie::Matrix6(law.per_K * law.taper->complianceAt(s))
                   : constantCompliance(section, unloaded);
}

lie::SE3 Rod::unloadedMotion(int section, double from, double to,
                             const model::Unloaded& unloaded) const {
  const auto profile = profileOf(section, unloaded);
  if (!profile) return lie::SE3::exp((to - from) * unloaded.twists.col(section));
  const int cells = laws_[section].taper->cells();
  lie::SE3 X;
  // Many steps of each cell: this is the start of a search and the shape of a weightless arm.
  for (int step = 0; step < kSteps * cells; ++step) {
    const double begin = std::max(from, static_cast<double>(step) / (kSteps * cells));
    const double end = std::min(to, (step + 1.0) / (kSteps * cells));
    if (begin < end) X = X * lie::SE3::exp(profile->step(begin, end));
  }
  return X;
}

lie::SO3 Rod::unloadedRotation(int section, double s, const model::Unloaded& unloaded) const {
  if (!laws_[section].taper) return lie::SO3::exp(s * unloaded.twists.col(section).tail<3>());
  return {Eigen::Quaterniond(unloadedMotion(section, 0.0, s, unloaded).rotation)};
}

Rod::Rod(const model::Arm& arm, const Load& given, double tolerance)
    : tolerance_(tolerance), links_(arm.links()) {
  const Load load = given.atEnds(links_.get());
  const int sections = arm.sectionCount();
  double bend = 0.0;
  for (int k = 0; k < sections; ++k) {
    const double l = arm.freeLength(k);
    laws_.push_back({complianceOf(arm, load, k), arm.equilibrium(k).null_space, arm.taper(k),
                     l / load.K_eps[k]});
    first_.push_back(arm.firstActuator(k));
    tapered_ = tapered_ || arm.taper(k);
    size_ += l;
    bend += laws_[k].C.bottomRightCorner<3, 3>().norm();
    force_scale_ += load.mass[k] * load.gravity.norm();
  }
  first_.push_back(arm.actuatorCount());
  requireTables(arm, load);
  has_tables_ = !load.tables.empty();
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
      const double begin =
          std::max(!points.empty() && points.back().section == k ? points.back().s : 0.0,
                   lastKnot(laws_[k], end));
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
