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

// X_1 .. X_j, the pose where piece j begins.
lie::SE3 pieceStart(const Shape& shape, int j) {
  lie::SE3 X;
  for (int i = 0; i < j; ++i) X = shape.beyond(X, i);
  return X;
}

void requireOnArm(double s, int sections) {
  if (s >= 0 && s <= sections) return;
  throw std::invalid_argument("s is " + std::to_string(s) + "; expected 0 to " +
                              std::to_string(sections));
}

}  // namespace

lie::SE3 poseAt(const Shape& shape, double s) {
  requireOnArm(s, shape.sectionCount());
  const double along = shape.piecesPerSection() * s;
  const int j = std::min(static_cast<int>(along), static_cast<int>(shape.pieces().cols()) - 1);
  return pieceStart(shape, j) * lie::SE3::exp((along - j) * shape.pieces().col(j));
}
lie::SE3 poseAt(const Shape& shape, int section, double s) {
  requireOnArm(section + s, shape.sectionCount());
  const int per_section = shape.piecesPerSection();
  const double along = per_section * s;
  const int piece = std::min(static_cast<int>(along), per_section - 1);
  const int j = section * per_section + piece;
  return pieceStart(shape, j) * lie::SE3::exp((along - piece) * shape.pieces().col(j));
}

std::vector<CurvePoint<lie::SE3>> sampleCurve(const Shape& shape, int count) {
  requireCurve(count);
  const auto& pieces = shape.pieces();
  std::vector<CurvePoint<lie::SE3>> out;
  out.reserve(count);
  int j = 0;
  lie::SE3 X_j;
  for (int i = 0; i < count; ++i) {
    const double s = curvePlace(shape.sectionCount(), i, count);
    const double along = shape.piecesPerSection() * s;
    for (; j + 1 < pieces.cols() && along >= j + 1; ++j) X_j = shape.beyond(X_j, j);
    out.push_back({s, X_j * lie::SE3::exp((along - j) * pieces.col(j))});
  }
  return out;
}

std::vector<CurvePoint<lie::SE3>> sampleToTip(const Shape& shape, int count) {
  std::vector<CurvePoint<lie::SE3>> out = sampleCurve(shape, count);
  if (shape.links()) out.push_back({out.back().s, tipPose(shape)});
  return out;
}

lie::SE3 tipPose(const Shape& shape) {
  return pieceStart(shape, static_cast<int>(shape.pieces().cols()));
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
