#include "helix_arm/statics/loaded.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "buckling.hpp"
#include "loaded_arm.hpp"

namespace helix_arm::statics {
namespace {

constexpr double kOutOfPlane = 1e-9;  // rounding of a base's rotation

bool inXY(const Eigen::Vector3d& v) { return std::abs(v.z()) <= kOutOfPlane * v.norm(); }

}  // namespace

const char* nameOf(SolveStatus status) {
  static constexpr std::array<const char*, 4> kNames = {"converged", "not_converged", "snapped",
                                                        "unsupported"};
  return kNames[static_cast<std::size_t>(status)];
}

bool inPlane(const Load& load) {
  const bool weighs =
      std::any_of(load.mass.begin(), load.mass.end(), [](double m) { return m > 0; });
  if (weighs && !inXY(load.gravity)) return false;
  return std::all_of(load.points.begin(), load.points.end(), [&load](const PointLoad& point) {
    const Eigen::Vector3d force = load.forceOf(point);
    return inXY(force) && (force.isZero(0) || inXY(point.offset)) &&
           point.moment.head<2>().norm() <= kOutOfPlane * point.moment.norm();
  });
}

bool staysInPlane(const model::Arm& arm, const Load& load) {
  load.validate(arm.sectionCount());
  return inPlane(load) && bucklingBound(arm, load) < 1.0;
}

template class LoadedArmOf<lie::SE3>;

}  // namespace helix_arm::statics
