#include "helix_arm/control/tip_path.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>
#include <utility>

#include <gtest/gtest.h>

#include "helix_arm/statics/inverse.hpp"
#include "support/allocation_counter.hpp"
#include "support/random.hpp"
#include "support/refusal.hpp"

namespace helix_arm::control {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

const double kNan = std::nan("");
const double kInfinity = std::numeric_limits<double>::infinity();

// One cubic polynomial per axis, and its derivative.
struct Cubic {
  Eigen::Matrix<double, 3, 4> c;
  Vector3d at(double t) const { return c * Eigen::Vector4d(1, t, t * t, t * t * t); }
  Vector3d slope(double t) const { return c * Eigen::Vector4d(0, 1, 2 * t, 3 * t * t); }
};

// Uneven times from 0 to 1, both included.
std::vector<double> unevenTimes(test::Random& random, int count) {
  std::vector<double> times{0.0, 1.0};
  for (int i = 2; i < count; ++i) times.push_back(random.uniform(0.001, 0.999));
  std::sort(times.begin(), times.end());
  return times;
}

std::vector<TipWayPoint> randomPoints(test::Random& random, int count) {
  std::vector<TipWayPoint> points;
  for (int i = 0; i < count; ++i) {
    const double last = points.empty() ? 0.5 : points.back().time;
    points.push_back({last + random.uniform(0.05, 0.5), 0.1 * random.direction<3>()});
  }
  return points;
}

Matrix3d turned(const Vector3d& axis, double angle) {
  return Eigen::AngleAxisd(angle, axis.normalized()).toRotationMatrix();
}

// The only cubic that rests at both ends is the spline through its own points, wherever they lie.
TEST(TipPath, WithoutVelocitiesACubicAtRestAtBothEndsIsReproduced) {
  test::Random random(2);
  for (const int count : {2, 3, 4, 20, 300}) {
    const Vector3d from = random.direction<3>(), change = random.direction<3>();
    Cubic cubic;
    cubic.c << from, Vector3d::Zero(), 3 * change, -2 * change;
    std::vector<TipWayPoint> points;
    for (const double t : unevenTimes(random, count)) points.push_back({t, cubic.at(t)});
    const TipPath path(points);
    for (int i = 0; i <= 100; ++i) {
      const TipReference reference = path.at(0.01 * i);
      EXPECT_LT((reference.position - cubic.at(0.01 * i)).norm(), 1e-14) << count;
      EXPECT_LT((reference.velocity - cubic.slope(0.01 * i)).norm(), 1e-9) << count;
    }
  }
}

TEST(TipPath, NoPlaceOfASegmentIsFasterThanItsTopSpeed) {
  test::Random random(8);
  double closest = kInfinity;
  for (int k = 0; k < 50; ++k) {
    std::vector<TipWayPoint> points = randomPoints(random, 5);
    for (TipWayPoint& point : points) {
      if (k % 2 == 0) point.velocity = random.uniform(0.0, 2.0) * random.direction<3>();
      point.rotation = turned(random.direction<3>(), random.uniform(0.0, 1.5));
    }
    const TipPath path(points);
    ASSERT_EQ(path.segmentCount(), points.size() - 1);
    for (std::size_t i = 0; i < path.segmentCount(); ++i) {
      const TipSegment segment = path.segment(i);
      EXPECT_EQ(segment.begin, points[i].time);
      EXPECT_EQ(segment.end, points[i + 1].time);
      for (int n = 1; n < 100; ++n) {
        const TipReference there =
            path.at(segment.begin + (segment.end - segment.begin) * n / 100.0);
        EXPECT_LE(there.velocity.norm(), segment.top_speed * (1 + 1e-12));
        EXPECT_NEAR(there.angular_velocity.norm(), segment.turn_rate, 1e-9 * segment.turn_rate);
        closest = std::min(closest, segment.top_speed - there.velocity.norm());
      }
    }
  }
  EXPECT_LT(closest, 0.01) << "the bound is attained";
}

// Acceleration on each side of a point, linear there: from two differences of the velocity.
TEST(TipPath, WithoutVelocitiesItPassesItsPointsWithoutAJerkAndTheEndsAreAtRest) {
  test::Random random(5);
  const std::vector<TipWayPoint> points = randomPoints(random, 30);
  const TipPath path(points);
  constexpr double kStep = 1e-3;
  const auto acceleration = [&path](double t, double side) {
    const Vector3d v0 = path.at(t).velocity, v1 = path.at(t + side).velocity,
                   v2 = path.at(t + 2 * side).velocity;
    return Vector3d((4 * v1 - 3 * v0 - v2) / (2 * side));
  };
  double largest = 0;
  EXPECT_EQ(path.firstTime(), points.front().time);
  EXPECT_EQ(path.lastTime(), points.back().time);
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_LT((path.at(points[i].time).position - points[i].position).norm(), 1e-15);
    if (i == 0 || i + 1 == points.size()) continue;
    const Vector3d before = acceleration(points[i].time, -kStep);
    EXPECT_LT((before - acceleration(points[i].time, kStep)).norm(), 1e-9) << i;
    largest = std::max(largest, before.norm());
  }
  EXPECT_GT(largest, 1.0);
  EXPECT_EQ(path.at(path.firstTime()).velocity, Vector3d(0, 0, 0));
  EXPECT_LT(path.at(path.lastTime()).velocity.norm(), 1e-14);
}

TEST(TipPath, RestsAtItsEndsBeforeAndAfter) {
  const Vector3d v(1, 2, 3);
  const Matrix3d I = Matrix3d::Identity(), R = turned({0, 0, 1}, 0.5);
  const TipPath path({{1.0, {1, 0, 0}, I, v}, {2.0, {0, 1, 0}, R, v}});
  EXPECT_EQ(path.at(1.0).velocity, v);
  EXPECT_LT((path.at(2.0).velocity - v).norm(), 1e-14);
  for (const double t : {-kInfinity, -1.0, 0.0, std::nextafter(1.0, 0.0), kNan,
                         std::nextafter(2.0, 3.0), 3.0, kInfinity}) {
    const bool after = t > 1.5;
    const TipReference reference = path.at(t);
    EXPECT_EQ(reference.position, after ? Vector3d(0, 1, 0) : Vector3d(1, 0, 0)) << t;
    EXPECT_LT((*reference.rotation - (after ? R : I)).norm(), 1e-15) << t;
    EXPECT_EQ(reference.velocity, Vector3d(0, 0, 0)) << t;
    EXPECT_EQ(reference.angular_velocity, Vector3d(0, 0, 0)) << t;
  }
}

TEST(TipPath, AngularVelocityIsThatOfTheRotationSeenFromTheBase) {
  test::Random random(6);
  std::vector<TipWayPoint> points = randomPoints(random, 10);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Matrix3d turn = turned(random.direction<3>(), random.uniform(-2.9, 2.9));
    points[i].rotation = i == 0 ? turn : Matrix3d(*points[i - 1].rotation * turn);
  }
  const TipPath path(points);
  constexpr double kStep = 1e-6;
  for (std::size_t i = 1; i < points.size(); ++i) {
    const double t = 0.5 * (points[i - 1].time + points[i].time);
    const Eigen::AngleAxisd turn(
        Matrix3d(*path.at(t + kStep).rotation * path.at(t - kStep).rotation->transpose()));
    const Vector3d w = turn.angle() * turn.axis() / (2 * kStep);
    EXPECT_LT((path.at(t).angular_velocity - w).norm(), 1e-8 * (1 + w.norm()) + 1e-8) << i;
    EXPECT_LT((*path.at(points[i].time).rotation - *points[i].rotation).norm(), 1e-14) << i;
  }
}

TEST(TipPath, IsAskedWithoutAllocationsInAnyOrder) {
  test::Random random(8);
  std::vector<TipWayPoint> points = randomPoints(random, 1000);
  for (TipWayPoint& point : points) point.rotation = turned({1, 0, 0}, random.uniform(0, 1));
  const TipPath path(points);
  static_assert(noexcept(path.at(0.0)));
  std::vector<double> times, forward, backward;
  for (double t = 0; t < path.lastTime() + 1; t += 0.1) times.push_back(t);
  forward.reserve(times.size());
  backward.reserve(times.size());
  const test::AllocationCounter counter;
  for (const double t : times) forward.push_back(path.at(t).position.x());
  for (std::size_t i = times.size(); i-- > 0;) backward.push_back(path.at(times[i]).position.x());
  EXPECT_EQ(counter.count(), 0u);
  std::reverse(backward.begin(), backward.end());
  EXPECT_EQ(forward, backward);
}

std::string refusalOf(const std::vector<TipWayPoint>& points) {
  return test::refusal([&points] { const TipPath path(points); });
}

// Three sound points with rotations and velocities, one of which is spoilt.
std::string spoilt(const std::function<void(std::vector<TipWayPoint>& points)>& spoil) {
  const Matrix3d I = Matrix3d::Identity();
  const Vector3d rest = Vector3d::Zero();
  std::vector<TipWayPoint> points{
      {0.5, {0, 0, 0}, I, rest}, {1.0, {0, 0, 0}, I, rest}, {2.0, {0, 0, 0}, I, rest}};
  spoil(points);
  return refusalOf(points);
}

TEST(TipPath, AFaultyPointIsRefusedByItsNumber) {
  using Points = std::vector<TipWayPoint>;
  const std::pair<int, std::function<void(Points & points)>> kFaults[] = {
      {1, [](Points& p) { p[0].time = -0.1; }},
      {2, [](Points& p) { p[1].time = kNan; }},
      {2, [](Points& p) { p[1].time = p[0].time; }},
      {2, [](Points& p) { p[1].position.y() = kNan; }},
      {1, [](Points& p) { p[0].velocity->x() = kInfinity; }},
      {3, [](Points& p) { p[2].velocity.reset(); }},
      {2, [](Points& p) { *p[1].rotation *= 1.1; }},
      {2, [](Points& p) { p[1].rotation = turned(Vector3d::UnitZ(), 3.1); }},
  };
  EXPECT_EQ(spoilt([](Points&) {}), "accepted");
  for (const auto& [point, spoil] : kFaults) {
    EXPECT_EQ(spoilt(spoil).find("tip path: point " + std::to_string(point)), 0U);
  }
}

using Eigen::Vector2d;

constexpr double kRadius = 0.02, kPeriod = 8.0;
const Vector3d kCentre(0.35, 0.01, -0.02);

ShapedPath shaped(TipShape shape, int turns = 1) {
  return {shape, kCentre, kRadius, kPeriod, turns, PathPlane::kYz};
}

// In the plane of the shape, centre 0, radius 1.
Vector2d inPlane(const Vector3d& position) { return (position - kCentre).tail<2>() / kRadius; }

// Distance from the curve of radius 1, to first order.
double offCurve(TipShape shape, const Vector2d& x) {
  if (shape == TipShape::kCircle) return std::abs(x.norm() - 1);
  if (shape == TipShape::kSquare) return std::abs(x.cwiseAbs().maxCoeff() - 1);
  const double r2 = x.squaredNorm();
  const Vector2d slope(4 * r2 * x[0] - 2 * x[0], 4 * r2 * x[1] + 2 * x[1]);
  return std::abs(r2 * r2 - x[0] * x[0] + x[1] * x[1]) / std::max(slope.norm(), 1e-3);
}

TEST(TipPathShapes, PointsLieOnTheCurveAndCloseIt) {
  for (const TipShape shape : kTipShapes) {
    const std::vector<TipWayPoint> points = wayPointsOf(shaped(shape));
    ASSERT_EQ(points.size(), 201u);
    for (std::size_t i = 0; i < points.size(); ++i) {
      EXPECT_DOUBLE_EQ(points[i].time, kPeriod * static_cast<double>(i) / 200);
      EXPECT_EQ(points[i].position.x(), kCentre.x());
      EXPECT_LT(offCurve(shape, inPlane(points[i].position)), 1e-12) << nameOf(shape) << " " << i;
      EXPECT_FALSE(points[i].rotation || points[i].velocity);
    }
    EXPECT_EQ(points.back().position, points.front().position) << nameOf(shape);
  }
}

TEST(TipApproach, CoversTheLineWithTheLeastJerkPolynomial) {
  const Vector3d from(0.3, 0.1, -0.1), to(0.35, -0.05, 0.05);
  const TipApproach approach(from, to);
  const double T = approach.duration();
  for (int i = 0; i <= 1000; ++i) {
    const double s = 1e-3 * i;
    const double covered = 10 * std::pow(s, 3) - 15 * std::pow(s, 4) + 6 * std::pow(s, 5);
    const double rate = 30 * std::pow(s, 2) - 60 * std::pow(s, 3) + 30 * std::pow(s, 4);
    const TipReference reference = approach.at(s * T);
    EXPECT_LT((reference.position - (from + covered * (to - from))).norm(), 1e-15);
    EXPECT_LT((reference.velocity - rate / T * (to - from)).norm(), 1e-14);
    EXPECT_FALSE(reference.rotation);
  }
}

// Half way, where the polynomial is fastest.
TEST(TipApproach, ReachesExactlyItsLargestSpeed) {
  const Vector3d from(0.3, 0.1, -0.1), to(0.35, -0.05, 0.05);
  for (const double most_speed : {kApproachSpeed, 0.02, 3.0}) {
    const TipApproach approach(from, to, most_speed);
    EXPECT_NEAR(approach.at(0.5 * approach.duration()).velocity.norm(), most_speed, 1e-12);
  }
  EXPECT_EQ(TipApproach(Vector3d(0, 0, 0), Vector3d(0.1, 0, 0)).duration(), 1.875);
}

TEST(TipApproach, BetweenPosesItTurnsAboutOneAxisAndNoFasterThanItMoves) {
  const Vector3d axis = Vector3d(1, 2, -1).normalized();
  const Matrix3d start = Eigen::AngleAxisd(0.7, Vector3d(0, 1, 0)).toRotationMatrix();
  const lie::SE3 from{start, {0.3, 0, 0}};
  const lie::SE3 to{Eigen::AngleAxisd(2.5, axis).toRotationMatrix() * start, {0.31, 0, 0}};
  const TipApproach approach(from, to);
  const double most_rate = kApproachSpeed / statics::InverseOptions().rotation_weight;
  EXPECT_NEAR(approach.duration(), 1.875 * 2.5 / most_rate, 1e-12);
  for (int i = 0; i <= 100; ++i) {
    const double s = 0.01 * i;
    const double covered = 10 * std::pow(s, 3) - 15 * std::pow(s, 4) + 6 * std::pow(s, 5);
    const double rate = 30 * std::pow(s * (1 - s), 2) / approach.duration();
    const TipReference reference = approach.at(s * approach.duration());
    const Matrix3d expected = Eigen::AngleAxisd(2.5 * covered, axis).toRotationMatrix() * start;
    EXPECT_LT((*reference.rotation - expected).norm(), 1e-14);
    EXPECT_LT((reference.angular_velocity - 2.5 * rate * axis).norm(), 1e-14);
  }
  // A position that is far and a small turn: the speed decides.
  EXPECT_NEAR(TipApproach(from, lie::SE3{start, {0.5, 0, 0}}).duration(), 1.875 * 0.2 / 0.1, 1e-12);
}

TEST(TipApproach, IsAskedWithoutAllocations) {
  const lie::SE3 to{Eigen::AngleAxisd(1.0, Vector3d(0, 1, 0)).toRotationMatrix(), {1, 0, 0}};
  const TipApproach approach(lie::SE3(), to);
  static_assert(noexcept(approach.at(0.0)));
  const test::AllocationCounter counter;
  double sum = 0;
  for (int i = -10; i < 1000; ++i) sum += approach.at(0.1 * i).rotation->sum();
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_TRUE(std::isfinite(sum));
}

}  // namespace
}  // namespace helix_arm::control
