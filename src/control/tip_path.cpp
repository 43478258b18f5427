#include "helix_arm/control/tip_path.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <string>

#include "basics/pi.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/statics/inverse.hpp"

namespace helix_arm::control {

/// @param quantity, unit  of the vector, for the message: "position", "m".
/// @param whose           its owner, for the message.
/// @throws std::invalid_argument unless all entries are finite and within statics::kFarthestTarget.
template <class... Whose>
void requireWithinReach(const Eigen::Vector3d& vector, const char* quantity, const char* unit,
                        const Whose&... whose) {
  for (int axis = 0; axis < 3; ++axis) {
    basics::require(std::abs(vector[axis]) <= statics::kFarthestTarget, whose..., " has ",
                    "xyz"[axis], " = ", vector[axis], " ", unit, " in its ", quantity,
                    "; expected a finite value of magnitude at most ", statics::kFarthestTarget,
                    ": give it in ", unit, ", seen from the arm's base");
  }
}

/// @throws std::invalid_argument unless R is orthogonal, within rounding, and right-handed.
template <class... Whose>
void requireRotation(const Eigen::Matrix3d& R, const Whose&... whose) {
  constexpr double kRounding = 1e-6;  // of R R' from the identity
  const double error = (R * R.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  basics::require(R.allFinite() && error <= kRounding, whose...,
                  " has a rotation R with R R' off the identity by ", error, "; expected at most ",
                  kRounding, ": normalise its quaternion");
  basics::require(R.determinant() > 0, whose...,
                  " has a rotation with determinant -1, a mirror image; expected +1: check the "
                  "order and signs of its axes");
}

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

static_assert(kPointsPerTurn % 4 == 0);

// Length of Bernoulli's lemniscate of radius 1: twice the lemniscate constant.
constexpr double kLemniscateLength = 5.24411510858423962093;

// Fraction of a side that is covered after the fraction w of its time. The speed rises as 3 q^2 - 2
// q^3, so that the acceleration at the corners is 0 and the spline does not overshoot them.
double sideCovered(double w) {
  constexpr double kCruise = 1.0 / (1.0 - kSquareRamp);
  if (w > 0.5) return 1.0 - sideCovered(1.0 - w);
  const double q = w / kSquareRamp;
  if (q >= 1) return kCruise * (w - 0.5 * kSquareRamp);
  return kCruise * kSquareRamp * q * q * q * (1.0 - 0.5 * q);
}

// One turn of a shape, radius 1, centre 0.
using Turn = Eigen::Matrix<double, 2, kPointsPerTurn>;

Turn circle() {
  Turn turn;
  for (int i = 0; i < kPointsPerTurn; ++i) {
    const double angle = 2.0 * basics::kPi * i / kPointsPerTurn;
    turn.col(i) << std::cos(angle), std::sin(angle);
  }
  return turn;
}

Turn square() {
  constexpr int kSide = kPointsPerTurn / 4;
  Turn turn;
  for (int i = 0; i < kSide; ++i) {
    const double along = 1.0 - 2.0 * sideCovered(static_cast<double>(i) / kSide);
    turn.col(i) << along, 1.0;
    turn.col(kSide + i) << -1.0, along;
    turn.col(2 * kSide + i) << -along, -1.0;
    turn.col(3 * kSide + i) << 1.0, -along;
  }
  return turn;
}

// (cos t, sin t cos t) / (1 + sin^2 t), where the arc length s grows evenly:
// dt/ds = sqrt(1 + sin^2 t), by Runge and Kutta.
Turn lemniscate() {
  constexpr int kSteps = 16;  // per point: to rounding
  constexpr double kStep = kLemniscateLength / (kPointsPerTurn * kSteps);
  const auto rate = [](double t) { return std::sqrt(1.0 + std::sin(t) * std::sin(t)); };
  Turn turn;
  double t = 0.0;
  for (int i = 0; i < kPointsPerTurn; ++i) {
    const double c = std::cos(t), s = std::sin(t);
    turn.col(i) = Eigen::Vector2d(c, s * c) / (1.0 + s * s);
    for (int k = 0; k < kSteps; ++k) {
      const double k1 = rate(t), k2 = rate(t + 0.5 * kStep * k1), k3 = rate(t + 0.5 * kStep * k2);
      t += kStep / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rate(t + kStep * k3));
    }
  }
  return turn;
}

Turn turnOf(TipShape shape) {
  if (shape == TipShape::kCircle) return circle();
  return shape == TipShape::kSquare ? square() : lemniscate();
}

void check(const ShapedPath& path) {
  constexpr char kCulprit[] = "path shape";
  constexpr double kShortestPeriod = 2.0 * kPointsPerTurn * kShortestStep;
  requireWithinReach(path.centre, "centre", "m", kCulprit);
  const double reach = path.centre.cwiseAbs().maxCoeff() + path.radius;
  basics::requireValue(path.radius > 0 && reach <= statics::kFarthestTarget, kCulprit, "radius",
                       path.radius, "a value > 0 [m], with the centre within 1e6 m");
  basics::requireValue(path.turns >= 1 && path.turns <= kMostTurns, kCulprit, "turns", path.turns,
                       "1 to " + std::to_string(kMostTurns));
  basics::requireValue(path.period >= kShortestPeriod && path.turns * path.period <= kLongestPath,
                       kCulprit, "period", path.period,
                       "at least 4e-4 s, and at most 1e6 s for all turns");
}

constexpr double kPeakRate = 15.0 / 8.0;  // 30 s^2 - 60 s^3 + 30 s^4 at s = 1/2

lie::SO3 rotationOf(const lie::SE3& X_BT, const char* whose) {
  requireRotation(X_BT.rotation, "tip approach: ", whose);
  return {Eigen::Quaterniond(X_BT.rotation).normalized()};
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

const char* nameOf(TipShape shape) {
  if (shape == TipShape::kCircle) return "circle";
  return shape == TipShape::kSquare ? "square" : "lemniscate";
}

const char* nameOf(PathPlane plane) {
  if (plane == PathPlane::kXy) return "xy";
  return plane == PathPlane::kXz ? "xz" : "yz";
}

std::vector<TipWayPoint> wayPointsOf(const ShapedPath& path) {
  check(path);
  const Turn turn = turnOf(path.shape);
  const int first = path.plane == PathPlane::kYz ? 1 : 0;
  const int second = path.plane == PathPlane::kXy ? 1 : 2;
  std::vector<TipWayPoint> points(static_cast<std::size_t>(path.turns * kPointsPerTurn + 1));
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector2d place = path.radius * turn.col(static_cast<int>(i % kPointsPerTurn));
    points[i].time = path.period * static_cast<double>(i) / kPointsPerTurn;
    points[i].position = path.centre;
    points[i].position[first] += place[0];
    points[i].position[second] += place[1];
  }
  return points;
}

TipApproach::TipApproach(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double most_speed)
    : from_(from), to_(to) {
  requireWithinReach(from, "position", "m", "tip approach: from");
  requireWithinReach(to, "position", "m", "tip approach: to");
  setDuration((to - from).norm(), most_speed);
}

TipApproach::TipApproach(const lie::SE3& from, const lie::SE3& to, double most_speed)
    : TipApproach(from.translation, to.translation, most_speed) {
  R_BT_ = rotationOf(from, "from");
  turn_ = (R_BT_->inverse() * rotationOf(to, "to")).log();
  const double weight = statics::InverseOptions().rotation_weight;
  setDuration(std::max((to_ - from_).norm(), weight * turn_.norm()), most_speed);
}

void TipApproach::setDuration(double length, double most_speed) {
  constexpr char kCulprit[] = "tip approach";
  basics::requireValue(std::isfinite(most_speed) && most_speed > 0, kCulprit, "most_speed",
                       most_speed, "a finite value > 0 [m/s]");
  duration_ = kPeakRate * length / most_speed;
  basics::require(duration_ <= kLongestPath, kCulprit, ": takes ", duration_, " s over ", length,
                  " m at a most_speed of ", most_speed, " m/s; expected at most ", kLongestPath,
                  " s: give a larger most_speed");
}

TipReference TipApproach::at(double time) const noexcept {
  const bool inside = time > 0 && time < duration_;
  double covered = time >= duration_ ? 1.0 : 0.0, rate = 0.0;
  if (inside) {
    const double s = time / duration_;
    covered = s * s * s * (10.0 + s * (6.0 * s - 15.0));
    rate = 30.0 * s * s * (1.0 - s) * (1.0 - s) / duration_;
  }
  TipReference reference;
  reference.position = covered < 1.0 ? Eigen::Vector3d(from_ + covered * (to_ - from_)) : to_;
  reference.velocity = rate * (to_ - from_);
  if (R_BT_) {
    const lie::SO3 R_BT = (*R_BT_ * lie::SO3::exp(covered * turn_)).normalized();
    reference.rotation = R_BT.quaternion.toRotationMatrix();
    reference.angular_velocity = rate * (R_BT_->quaternion * turn_);
  }
  return reference;
}

}  // namespace helix_arm::control
