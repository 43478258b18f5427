#include "helix_arm/model/curve.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "helix_arm/model/curve_place.hpp"

namespace helix_arm::model {
namespace {

constexpr double kTurn = 6.283185307179586;  // 2 pi

// X_1 .. X_j, the pose where piece j begins.
template <class Group, class Pieces>
Group pieceStart(const Pieces& pieces, int j) {
  Group X;
  for (int i = 0; i < j; ++i) X = X * Group::exp(pieces.col(i));
  return X;
}

void requireOnArm(double s, int sections) {
  if (s >= 0 && s <= sections) return;
  throw std::invalid_argument("s is " + std::to_string(s) + "; expected 0 to " +
                              std::to_string(sections));
}

template <class Group, class Pieces>
Group poseOnCurve(const Pieces& pieces, double along) {
  const int j =
      static_cast<int>(std::min(std::floor(along), static_cast<double>(pieces.cols() - 1)));
  return pieceStart<Group>(pieces, j) * Group::exp((along - j) * pieces.col(j));
}

template <class Group, class Pieces>
std::vector<CurvePoint<Group>> sample(const Pieces& pieces, int sections, int count) {
  requireCurve(count);
  const auto per_section = static_cast<double>(pieces.cols() / sections);
  std::vector<CurvePoint<Group>> curve;
  curve.reserve(count);
  int j = 0;
  Group X_j;
  for (int i = 0; i < count; ++i) {
    const double s = curvePlace(sections, i, count);
    const double along = per_section * s;
    for (; j + 1 < pieces.cols() && along >= j + 1; ++j) X_j = X_j * Group::exp(pieces.col(j));
    curve.push_back({s, X_j * Group::exp((along - j) * pieces.col(j))});
  }
  return curve;
}

}  // namespace

lie::SE3 poseAt(const Shape& shape, double s) {
  requireOnArm(s, shape.sectionCount());
  return poseOnCurve<lie::SE3>(shape.pieces(), shape.piecesPerSection() * s);
}
lie::SE2 poseAt(const PlanarTwists& twists, double s) {
  requireOnArm(s, static_cast<int>(twists.cols()));
  return poseOnCurve<lie::SE2>(twists, s);
}

std::vector<CurvePoint<lie::SE3>> sampleCurve(const Shape& shape, int count) {
  return sample<lie::SE3>(shape.pieces(), shape.sectionCount(), count);
}
std::vector<CurvePoint<lie::SE2>> sampleCurve(const PlanarTwists& twists, int count) {
  return sample<lie::SE2>(twists, static_cast<int>(twists.cols()), count);
}

lie::SE3 tipPose(const Shape& shape) {
  return pieceStart<lie::SE3>(shape.pieces(), static_cast<int>(shape.pieces().cols()));
}
lie::SE2 tipPose(const PlanarTwists& twists) {
  return pieceStart<lie::SE2>(twists, static_cast<int>(twists.cols()));
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
