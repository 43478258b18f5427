#include "helix_arm/model/curve.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace helix_arm::model {
namespace {

constexpr double kTurn = 6.283185307179586;  // 2 pi

// X_1 .. X_k, the pose where section k begins.
template <class Group>
Group sectionStart(const TwistsOf<Group>& twists, int k) {
  Group X;
  for (int j = 0; j < k; ++j) X = X * Group::exp(twists.col(j));
  return X;
}

template <class Group>
Group poseOnCurve(const TwistsOf<Group>& twists, double s) {
  const auto sections = static_cast<double>(twists.cols());
  if (!(s >= 0 && s <= sections)) {
    throw std::invalid_argument("s is " + std::to_string(s) + "; expected 0 to " +
                                std::to_string(twists.cols()));
  }
  const int k = static_cast<int>(std::min(std::floor(s), sections - 1));
  return sectionStart<Group>(twists, k) * Group::exp((s - k) * twists.col(k));
}

template <class Group>
std::vector<CurvePoint<Group>> sample(const TwistsOf<Group>& twists, int count) {
  if (count < 2)
    throw std::invalid_argument("a curve of " + std::to_string(count) +
                                " points; expected at least 2");
  const auto sections = static_cast<double>(twists.cols());
  std::vector<CurvePoint<Group>> curve;
  curve.reserve(count);
  int k = 0;
  Group X_k;
  for (int i = 0; i < count; ++i) {
    const double s = sections * i / (count - 1);
    for (; k + 1 < twists.cols() && s >= k + 1; ++k) X_k = X_k * Group::exp(twists.col(k));
    curve.push_back({s, X_k * Group::exp((s - k) * twists.col(k))});
  }
  return curve;
}

}  // namespace

lie::SE3 poseAt(const Twists& twists, double s) { return poseOnCurve<lie::SE3>(twists, s); }
lie::SE2 poseAt(const PlanarTwists& twists, double s) { return poseOnCurve<lie::SE2>(twists, s); }

std::vector<CurvePoint<lie::SE3>> sampleCurve(const Twists& twists, int count) {
  return sample<lie::SE3>(twists, count);
}
std::vector<CurvePoint<lie::SE2>> sampleCurve(const PlanarTwists& twists, int count) {
  return sample<lie::SE2>(twists, count);
}

lie::SE3 tipPose(const Twists& twists) {
  return sectionStart<lie::SE3>(twists, static_cast<int>(twists.cols()));
}
lie::SE2 tipPose(const PlanarTwists& twists) {
  return sectionStart<lie::SE2>(twists, static_cast<int>(twists.cols()));
}

Helix helixOf(const lie::Vector6& twist) {
  const Eigen::Vector3d v = twist.head<3>(), w = twist.tail<3>();
  const double angle = w.stableNorm();
  const Eigen::Vector3d axis = angle > 0 ? Eigen::Vector3d(w / angle) : Eigen::Vector3d::Zero();
  if (angle == 0) return {std::numeric_limits<double>::infinity(), 0.0, 0.0};
  return {axis.cross(v).norm() / angle, kTurn * axis.dot(v) / angle, angle / kTurn};
}

double curvatureOf(const lie::Vector6& twist) { return std::hypot(twist[4], twist[5]); }

}  // namespace helix_arm::model
