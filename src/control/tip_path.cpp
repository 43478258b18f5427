#include "helix_arm/control/tip_path.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "helix_arm/basics/requirement.hpp"
#include "tip_rules.hpp"

namespace helix_arm::control {
namespace {

using basics::require;

constexpr char kPoint[] = "tip path: point ";

void checkTime(const std::vector<TipWayPoint>& points, std::size_t i) {
  const double time = points[i].time;
  require(time >= 0 && time <= kLongestPath, kPoint, i + 1, " has the time ", time,
          " s; expected 0 to ", kLongestPath, " s: count from the start of the path");
  if (i == 0) return;
  const double step = time - points[i - 1].time;
  require(step >= kShortestStep, kPoint, i + 1, " comes ", step, " s after point ", i,
          "; expected at least ", kShortestStep,
          " s: sort the points by time and leave out repeated ones");
}

// Checks that an optional member is given as in the first point.
void checkGiven(bool given, bool expected, std::size_t i, const char* what) {
  require(given == expected, kPoint, i + 1, given ? " has a " : " has no ", what,
          ", unlike point 1; expected a ", what, " for all points or for none");
}

void checkPoint(const std::vector<TipWayPoint>& points, std::size_t i) {
  const TipWayPoint &point = points[i], &first = points.front();
  checkTime(points, i);
  requireWithinReach(point.position, "position", "m", kPoint, i + 1);
  checkGiven(point.velocity.has_value(), first.velocity.has_value(), i, "velocity");
  if (point.velocity) requireWithinReach(*point.velocity, "velocity", "m/s", kPoint, i + 1);
  checkGiven(point.rotation.has_value(), first.rotation.has_value(), i, "rotation");
  if (point.rotation) requireRotation(*point.rotation, kPoint, i + 1);
}

// Velocities (3 x n) of the cubic spline with continuous acceleration, 0 at both ends. With h_i the
// time from point i to i + 1 and d_i the mean velocity meanwhile, an inner point has
//   h_i v_(i-1) + 2 (h_(i-1) + h_i) v_i + h_(i-1) v_(i+1) = 3 (h_i d_(i-1) + h_(i-1) d_i).
// Diagonally dominant, so elimination without pivots is stable.
Eigen::Matrix3Xd splineVelocities(const std::vector<TipWayPoint>& points) {
  const auto n = static_cast<Eigen::Index>(points.size());
  const auto step = [&points](Eigen::Index i) { return points[i + 1].time - points[i].time; };
  const auto mean = [&](Eigen::Index i) {
    return Eigen::Vector3d((points[i + 1].position - points[i].position) / step(i));
  };
  Eigen::Matrix3Xd v = Eigen::Matrix3Xd::Zero(3, n);
  Eigen::VectorXd above = Eigen::VectorXd::Zero(n);  // superdiagonal after elimination
  for (Eigen::Index i = 1; i + 1 < n; ++i) {
    const double before = step(i) / (step(i - 1) + step(i)), after = 1.0 - before;
    const double pivot = 2.0 - before * above[i - 1];
    above[i] = after / pivot;
    v.col(i) = (3.0 * (before * mean(i - 1) + after * mean(i)) - before * v.col(i - 1)) / pivot;
  }
  for (Eigen::Index i = n - 2; i > 0; --i) v.col(i) -= above[i] * v.col(i + 1);
  return v;
}

}  // namespace

TipPath::TipPath(const std::vector<TipWayPoint>& points) {
  require(points.size() >= kFewestWayPoints && points.size() <= kMostWayPoints, "tip path: has ",
          points.size(), " points; expected ", kFewestWayPoints, " to ", kMostWayPoints,
          ": send a single position as a target, and a longer path in parts");
  for (std::size_t i = 0; i < points.size(); ++i) checkPoint(points, i);
  has_rotations_ = points.front().rotation.has_value();
  Eigen::Matrix3Xd spline;
  if (!points.front().velocity) spline = splineVelocities(points);
  knots_.reserve(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const TipWayPoint& point = points[i];
    Knot knot{point.time, point.position, {}, {}, Eigen::Vector3d::Zero()};
    knot.velocity = point.velocity ? *point.velocity : spline.col(static_cast<Eigen::Index>(i));
    if (has_rotations_) knot.R_BT.quaternion = Eigen::Quaterniond(*point.rotation).normalized();
    knots_.push_back(knot);
  }
  for (std::size_t i = 1; i < knots_.size(); ++i) {
    Eigen::Vector3d& turn = knots_[i - 1].turn;
    turn = (knots_[i - 1].R_BT.inverse() * knots_[i].R_BT).log();
    require(turn.norm() <= kLargestTurn, kPoint, i + 1, " is turned by ", turn.norm(),
            " rad from point ", i, "; expected at most ", kLargestTurn,
            " rad, less than a half turn: add a point between them");
  }
}

TipReference TipPath::atRest(const Knot& knot) const noexcept {
  TipReference reference;
  reference.position = knot.position;
  if (has_rotations_) reference.rotation = knot.R_BT.quaternion.toRotationMatrix();
  return reference;
}

TipReference TipPath::at(double time) const noexcept {
  if (!(time >= firstTime())) return atRest(knots_.front());
  if (time > lastTime()) return atRest(knots_.back());
  const auto next =
      std::upper_bound(knots_.begin() + 1, knots_.end() - 1, time,
                       [](double wanted, const Knot& knot) { return wanted < knot.time; });
  const Knot &a = *(next - 1), &b = *next;
  const double h = b.time - a.time, u = (time - a.time) / h;
  const Eigen::Vector3d change = b.position - a.position;
  const Eigen::Vector3d quadratic = 3.0 * change - h * (2.0 * a.velocity + b.velocity);
  const Eigen::Vector3d cubic = h * (a.velocity + b.velocity) - 2.0 * change;
  TipReference reference;
  reference.position = a.position + u * (h * a.velocity + u * (quadratic + u * cubic));
  reference.velocity = a.velocity + u / h * (2.0 * quadratic + 3.0 * u * cubic);
  if (has_rotations_) {
    const lie::SO3 R_BT = (a.R_BT * lie::SO3::exp(u * a.turn)).normalized();
    reference.rotation = R_BT.quaternion.toRotationMatrix();
    reference.angular_velocity = a.R_BT.quaternion * a.turn / h;
  }
  return reference;
}

TipSegment TipPath::segment(std::size_t i) const {
  const Knot &a = knots_[i], &b = knots_[i + 1];
  const double h = b.time - a.time;
  const Eigen::Vector3d middle = 3.0 / h * (b.position - a.position) - a.velocity - b.velocity;
  return {a.time, b.time, std::max({a.velocity.norm(), middle.norm(), b.velocity.norm()}),
          a.turn.norm() / h};
}

}  // namespace helix_arm::control
