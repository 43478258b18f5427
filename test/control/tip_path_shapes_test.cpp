#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <utility>

#include <gtest/gtest.h>

#include "helix_arm/basics/pi.hpp"
#include "helix_arm/control/tip_path.hpp"
#include "support/refusal.hpp"

namespace helix_arm::control {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

const double kNan = std::nan("");
const double kInfinity = std::numeric_limits<double>::infinity();
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

TEST(TipPathShapes, BeginOnTheirFirstAxisAndRunToTheSecond) {
  const auto expect = [](TipShape shape, const std::vector<Vector2d>& quarters) {
    const std::vector<TipWayPoint> points = wayPointsOf(shaped(shape));
    for (std::size_t i = 0; i < quarters.size(); ++i) {
      EXPECT_LT((inPlane(points[50 * i].position) - quarters[i]).norm(), 1e-12)
          << nameOf(shape) << " " << i;
    }
    const Vector2d early = inPlane(points[10].position);
    EXPECT_TRUE(shape == TipShape::kSquare ? early[0] < 1 : early[1] > 0) << nameOf(shape);
  };
  expect(TipShape::kCircle, {{1, 0}, {0, 1}, {-1, 0}, {0, -1}});
  expect(TipShape::kSquare, {{1, 1}, {-1, 1}, {-1, -1}, {1, -1}});
  expect(TipShape::kLemniscate, {{1, 0}, {0, 0}, {-1, 0}, {0, 0}});
}

TEST(TipPathShapes, PlanesHaveTheAxesOfTheirNames) {
  for (const PathPlane plane : kPathPlanes) {
    ShapedPath path = shaped(TipShape::kCircle);
    path.plane = plane;
    const std::vector<TipWayPoint> points = wayPointsOf(path);
    const std::string name = nameOf(plane);
    Vector3d begin = Vector3d::Zero(), quarter = Vector3d::Zero();
    begin[name[0] - 'x'] = kRadius;
    quarter[name[1] - 'x'] = kRadius;
    EXPECT_LT((points[0].position - kCentre - begin).norm(), 1e-15) << name;
    EXPECT_LT((points[50].position - kCentre - quarter).norm(), 1e-15) << name;
  }
}

TEST(TipPathShapes, EveryTurnIsTheSame) {
  for (const TipShape shape : kTipShapes) {
    const std::vector<TipWayPoint> once = wayPointsOf(shaped(shape));
    const std::vector<TipWayPoint> thrice = wayPointsOf(shaped(shape, 3));
    ASSERT_EQ(thrice.size(), 601u);
    EXPECT_DOUBLE_EQ(thrice.back().time, 3 * kPeriod);
    for (std::size_t i = 0; i < thrice.size(); ++i) {
      EXPECT_EQ(thrice[i].position, once[i % 200].position);
    }
  }
}

// The lemniscate constant is half the length of the curve of radius 1 (Gauss).
TEST(TipPathShapes, CircleAndLemniscateHaveAConstantSpeed) {
  for (const auto& [shape, length] : {std::pair{TipShape::kCircle, 2 * basics::kPi},
                                      std::pair{TipShape::kLemniscate, 2 * 2.622057554292119}}) {
    const TipPath path(wayPointsOf(shaped(shape)));
    for (double t = 0.1 * kPeriod; t < 0.9 * kPeriod; t += 0.01) {
      EXPECT_NEAR(path.at(t).velocity.norm(), length * kRadius / kPeriod, 1e-5 * kRadius)
          << nameOf(shape);
    }
  }
}

TEST(TipPathShapes, ASquareRestsAtItsCornersAndIsEvenBetweenThem) {
  const TipPath path(wayPointsOf(shaped(TipShape::kSquare)));
  const double side = 0.25 * kPeriod, speed = 2 * kRadius / (side * (1 - kSquareRamp));
  for (int corner = 0; corner <= 4; ++corner) {
    EXPECT_LT(path.at(corner * side).velocity.norm(), 1e-2 * speed) << corner;
    if (corner == 4) break;
    for (double w = kSquareRamp + 0.06; w < 1 - kSquareRamp - 0.06; w += 0.01) {
      EXPECT_NEAR(path.at((corner + w) * side).velocity.norm(), speed, 1e-3 * speed) << w;
    }
  }
}

TEST(TipPathShapes, TheSplineStaysOnTheCurve) {
  for (const TipShape shape : kTipShapes) {
    const TipPath path(wayPointsOf(shaped(shape, 2)));
    double most = 0;
    for (int i = 0; i <= 20000; ++i) {
      const Vector3d position = path.at(1e-4 * i * kPeriod).position;
      most = std::max(most, offCurve(shape, inPlane(position)));
    }
    EXPECT_LT(most, 2e-4) << nameOf(shape);
  }
}

TEST(TipPathShapes, TheSplineIsInTimeExceptForTheFirstAndLastSteps) {
  const TipPath path(wayPointsOf(shaped(TipShape::kCircle)));
  double most = 0, most_inside = 0;
  for (int i = 0; i <= 20000; ++i) {
    const double u = 5e-5 * i, angle = 2 * basics::kPi * u;
    const Vector2d wanted(std::cos(angle), std::sin(angle));
    const double error = (inPlane(path.at(u * kPeriod).position) - wanted).norm();
    most = std::max(most, error);
    if (u > 0.05 && u < 0.95) most_inside = std::max(most_inside, error);
  }
  EXPECT_LT(most, 1e-2);
  EXPECT_LT(most_inside, 1e-6);
}

TEST(TipPathShapes, TheLargestAndTheSmallestAreSoundPaths) {
  for (const TipShape shape : kTipShapes) {
    ShapedPath path = shaped(shape, kMostTurns);
    EXPECT_NO_THROW(TipPath(wayPointsOf(path)));
    path.period = kLongestPath / kMostTurns;
    path.centre = Vector3d(9e5, -9e5, 0);
    path.radius = 1e5;
    EXPECT_NO_THROW(TipPath(wayPointsOf(path)));
    path.period = 2 * kPointsPerTurn * kShortestStep;
    path.radius = 1e-6;
    EXPECT_NO_THROW(TipPath(wayPointsOf(path)));
  }
}

TEST(TipPathShapes, WhatBreaksARuleIsNamed) {
  const auto refused = [](const std::function<void(ShapedPath & path)>& spoil) {
    ShapedPath path = shaped(TipShape::kCircle, 2);
    spoil(path);
    return test::refusal([&path] { wayPointsOf(path); });
  };
  const std::string culprit = "path shape";
  const std::string radius = "; expected a value > 0 [m], with the centre within 1e6 m";
  const std::string period = "; expected at least 4e-4 s, and at most 1e6 s for all turns";
  EXPECT_EQ(refused([](ShapedPath&) {}), "accepted");
  EXPECT_EQ(refused([](ShapedPath& p) { p.radius = 0; }), culprit + ": radius is 0" + radius);
  EXPECT_EQ(refused([](ShapedPath& p) { p.radius = kNan; }), culprit + ": radius is nan" + radius);
  EXPECT_EQ(refused([](ShapedPath& p) { p.radius = 1e6; }), culprit + ": radius is 1e+06" + radius);
  EXPECT_EQ(refused([](ShapedPath& p) { p.centre.z() = kInfinity; }),
            culprit +
                " has z = inf m in its centre; expected a finite value of magnitude at most "
                "1e+06: give it in m, seen from the arm's base");
  for (const double value : {-1.0, 0.0, 3e-4, 6e5, kInfinity, kNan}) {
    EXPECT_NE(refused([&](ShapedPath& p) { p.period = value; }).find(period), std::string::npos)
        << value;
  }
  for (const int turns : {-1, 0, kMostTurns + 1}) {
    EXPECT_EQ(refused([&](ShapedPath& p) { p.turns = turns; }),
              culprit + ": turns is " + std::to_string(turns) + "; expected 1 to 499");
  }
}

}  // namespace
}  // namespace helix_arm::control
