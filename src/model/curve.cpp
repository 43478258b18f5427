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

// Constant twists in series, with what lies between them.
struct PlanarPieces {
  const PlanarTwists& twists;

  const PlanarTwists& pieces() const { return twists; }
  int sectionCount() const { return static_cast<int>(twists.cols()); }
  static int piecesPerSection() { return 1; }
  lie::SE2 beyond(const lie::SE2& X, int j) const { return X * lie::SE2::exp(twists.col(j)); }
};

// X_1 .. X_j, the pose where piece j begins.
template <class Group, class Curve>
Group pieceStart(const Curve& curve, int j) {
  Group X;
  for (int i = 0; i < j; ++i) X = curve.beyond(X, i);
  return X;
}

void requireOnArm(double s, int sections) {
  if (s >= 0 && s <= sections) return;
  throw std::invalid_argument("s is " + std::to_string(s) + "; expected 0 to " +
                              std::to_string(sections));
}

template <class Group, class Curve>
Group poseOnCurve(const Curve& curve, int section, double s) {
  const int per_section = curve.piecesPerSection();
  const double along = per_section * s;
  const int piece = std::min(static_cast<int>(along), per_section - 1);
  const int j = section * per_section + piece;
  return pieceStart<Group>(curve, j) * Group::exp((along - piece) * curve.pieces().col(j));
}

template <class Group, class Curve>
Group poseOnCurve(const Curve& curve, double s) {
  requireOnArm(s, curve.sectionCount());
  const int per_section = curve.piecesPerSection();
  const double along = per_section * s;
  const int j =
      static_cast<int>(std::min(std::floor(along), static_cast<double>(curve.pieces().cols() - 1)));
  return pieceStart<Group>(curve, j) * Group::exp((along - j) * curve.pieces().col(j));
}

template <class Group, class Curve>
std::vector<CurvePoint<Group>> sample(const Curve& curve, int count) {
  requireCurve(count);
  const int sections = curve.sectionCount();
  const auto& pieces = curve.pieces();
  const auto per_section = static_cast<double>(curve.piecesPerSection());
  std::vector<CurvePoint<Group>> out;
  out.reserve(count);
  int j = 0;
  Group X_j;
  for (int i = 0; i < count; ++i) {
    const double s = curvePlace(sections, i, count);
    const double along = per_section * s;
    for (; j + 1 < pieces.cols() && along >= j + 1; ++j) X_j = curve.beyond(X_j, j);
    out.push_back({s, X_j * Group::exp((along - j) * pieces.col(j))});
  }
  return out;
}

}  // namespace

lie::SE3 poseAt(const Shape& shape, double s) { return poseOnCurve<lie::SE3>(shape, s); }
lie::SE3 poseAt(const Shape& shape, int section, double s) {
  requireOnArm(section + s, shape.sectionCount());
  return poseOnCurve<lie::SE3>(shape, section, s);
}
lie::SE2 poseAt(const PlanarTwists& twists, double s) {
  return poseOnCurve<lie::SE2>(PlanarPieces{twists}, s);
}

std::vector<CurvePoint<lie::SE3>> sampleCurve(const Shape& shape, int count) {
  return sample<lie::SE3>(shape, count);
}
std::vector<CurvePoint<lie::SE2>> sampleCurve(const PlanarTwists& twists, int count) {
  return sample<lie::SE2>(PlanarPieces{twists}, count);
}

std::vector<CurvePoint<lie::SE3>> sampleToTip(const Shape& shape, int count) {
  std::vector<CurvePoint<lie::SE3>> out = sampleCurve(shape, count);
  if (shape.links()) out.push_back({out.back().s, tipPose(shape)});
  return out;
}

lie::SE3 tipPose(const Shape& shape) {
  return pieceStart<lie::SE3>(shape, static_cast<int>(shape.pieces().cols()));
}
lie::SE2 tipPose(const PlanarTwists& twists) {
  return pieceStart<lie::SE2>(PlanarPieces{twists}, static_cast<int>(twists.cols()));
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
