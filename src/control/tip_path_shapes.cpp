#include "helix_arm/control/tip_path_shapes.hpp"

#include <cmath>
#include <string>

#include "helix_arm/basics/pi.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "tip_rules.hpp"

namespace helix_arm::control {
namespace {

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

}  // namespace

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

}  // namespace helix_arm::control
