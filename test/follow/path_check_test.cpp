#include "helix_arm/follow/path_check.hpp"

#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/control/tip_path.hpp"
#include "support/has.hpp"
#include "support/paper_arm.hpp"
#include "support/random.hpp"

namespace helix_arm::follow {
namespace {

using control::TipPath;
using control::TipWayPoint;

constexpr double kSlew = 5e5;  // [Pa/s]

class PathCheck : public testing::Test {
 protected:
  std::optional<PathRefusal> check(const TipPath& path, double slew = kSlew,
                                   double tolerance = kPathTolerance) {
    return checkPath(path, arm, solver, arm.inputAt(0.0),
                     {tolerance, Eigen::VectorXd::Constant(3, slew)});
  }
  Eigen::Vector3d tipAt(const Eigen::Vector3d& fractions) const {
    return arm.tip(arm.inputAt(fractions)).translation;
  }
  // A circle around a place in the middle of the reach.
  TipPath circle(double period, double radius = 0.02) const {
    control::ShapedPath shape;
    shape.centre = tipAt({0.5, 0.4, 0.4});
    shape.radius = radius;
    shape.period = period;
    return TipPath(control::wayPointsOf(shape));
  }
  static TipPath straight(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double duration) {
    return TipPath({{0.0, from}, {duration, to}});
  }

  const model::Arm arm = test::ringArm({3, 0.0254, test::kPi / 12, {100.0, 0.0, 9.8e-5}});
  statics::InverseSolver solver{arm};
};

TEST_F(PathCheck, APathWithinReachAndRatesIsAccepted) { EXPECT_FALSE(check(circle(8))); }

TEST_F(PathCheck, TheFactorThatItNamesIsJustEnough) {
  const double infinity = std::numeric_limits<double>::infinity();
  const auto refused = check(circle(0.5));
  ASSERT_TRUE(refused);
  EXPECT_EQ(refused->fault, PathFault::kTooFast);
  EXPECT_GT(refused->stretch, 1);
  EXPECT_NEAR(refused->rate, refused->stretch * kSlewShare * kSlew, 1e-6 * refused->rate);
  EXPECT_FALSE(check(circle(0.5 * 1.02 * refused->stretch)));
  const auto nearly = check(circle(0.5 * 0.98 * refused->stretch));
  ASSERT_TRUE(nearly);
  EXPECT_NEAR(nearly->stretch, 1 / 0.98, 0.01);
  EXPECT_FALSE(check(circle(0.5), infinity));
  EXPECT_TRUE(test::has(refused->reason, "multiply all times by "));
}

TEST_F(PathCheck, APlaceOutOfReachIsNamedWithItsDistance) {
  const Eigen::Vector3d inside = tipAt({0.5, 0.4, 0.4}),
                        outside = inside + Eigen::Vector3d(0.2, 0, 0);
  const auto refused = check(straight(inside, outside, 10));
  ASSERT_TRUE(refused);
  EXPECT_EQ(refused->fault, PathFault::kUnreachable);
  EXPECT_NEAR(refused->time, 10, 1e-9) << "the end is farthest";
  EXPECT_LT((refused->position - outside).norm(), 1e-9);
  statics::InverseSolver fresh(arm);
  EXPECT_NEAR(refused->residual, fresh.toPosition(outside, arm.inputAt(0.0)).residual, 1e-6);
  // The tolerance, from both sides.
  EXPECT_TRUE(check(straight(inside, outside, 60), kSlew, 0.99 * refused->residual));
  EXPECT_FALSE(check(straight(inside, outside, 60), kSlew, 1.01 * refused->residual));
}

// Behind the base the closest shape bends to one side or to the other.
TEST_F(PathCheck, PressuresThatHaveToJumpAreNoMatterOfSpeed) {
  const Eigen::Vector3d one(-0.05, -0.3, 0.0), other(-0.05, 0.3, 0.0);
  for (const double duration : {10.0, 100.0}) {
    const auto refused = check(straight(one, other, duration), kSlew, 1.0);
    ASSERT_TRUE(refused);
    EXPECT_EQ(refused->fault, PathFault::kJump) << refused->reason;
  }
}

// The arm rests, except for a moment in which it should be 0.3 m away.
TEST_F(PathCheck, ASpikeOfAnyLengthIsFound) {
  const Eigen::Vector3d rest = tipAt({0.5, 0.4, 0.4}), away = rest + Eigen::Vector3d(0, 0.3, 0),
                        still = Eigen::Vector3d::Zero();
  for (const double length : {1e-5, 1e-3, 4e-3, 0.1}) {
    const double middle = 1.0050001;
    const TipPath path({{0.0, rest, {}, still},
                        {middle - length / 2, rest, {}, still},
                        {middle, away, {}, still},
                        {middle + length / 2, rest, {}, still},
                        {4.0, rest, {}, still}});
    const auto refused = check(path, std::numeric_limits<double>::infinity());
    ASSERT_TRUE(refused) << length;
    EXPECT_EQ(refused->fault, PathFault::kUnreachable);
    EXPECT_NEAR(refused->time, middle, 1e-12) << "the farthest place";
  }
  // Between two points at the same place, 10 ms apart: h (v_a - v_b) / 8 away in the middle.
  const Eigen::Vector3d fast(0, 0.3 * 4 / 0.01, 0);
  const auto refused =
      check(TipPath({{1.0, rest, {}, fast}, {1.01, rest, {}, Eigen::Vector3d(-fast)}}),
            std::numeric_limits<double>::infinity());
  ASSERT_TRUE(refused);
  EXPECT_EQ(refused->fault, PathFault::kUnreachable);
  EXPECT_NEAR(refused->time, 1.005, 1e-3);
}

// At times of no grid, with polynomials that turn between the points.
TEST_F(PathCheck, EveryPlaceOfAnAcceptedPathIsWithinReach) {
  test::Random random(7);
  const Eigen::Vector3d middle = tipAt({0.5, 0.4, 0.4});
  statics::InverseSolver fresh(arm);
  int accepted = 0, refused = 0;
  for (int trial = 0; trial < 100; ++trial) {
    std::vector<TipWayPoint> points;
    const double step = std::pow(10.0, random.uniform(-3, -1));
    const double size = random.uniform(0.0, 0.03), swing = random.uniform(0.0, 0.3);
    for (int k = 0; k < 6; ++k) {
      points.push_back({step * (k + random.uniform(0, 0.5)),
                        middle + size * random.direction<3>(),
                        {},
                        Eigen::Vector3d(swing / step * random.direction<3>())});
    }
    const TipPath path(points);
    if (check(path, std::numeric_limits<double>::infinity())) {
      ++refused;
      continue;
    }
    ++accepted;
    Eigen::VectorXd input = arm.inputAt(0.4);
    for (int k = 0; k < 1000; ++k) {
      const double time = random.uniform(path.firstTime(), path.lastTime());
      const auto& result = fresh.toPosition(path.at(time).position, input);
      EXPECT_LE(result.residual, kPathTolerance + kCheckSpacing / 2) << trial << " at " << time;
    }
  }
  EXPECT_GT(accepted, 10);
  EXPECT_GT(refused, 10);
}

// A ball beside the path, and one between two clear points of it.
TEST_F(PathCheck, AZoneOnTheWayIsNamed) {
  const Eigen::Vector3d from = tipAt({0.9, 0.1, 0.1}), to = tipAt({0.1, 0.9, 0.1});
  const TipPath path = straight(from, to, 60);
  ASSERT_FALSE(check(path));
  clearance::KeepOut keep_out;
  keep_out.radii = {0.02};
  clearance::Zone ball{"ball", clearance::Sphere{0.003}, {}};
  const auto refusal = [&](const Eigen::Vector3d& place) {
    ball.X_WZ.translation = place;
    keep_out.zones = {ball};
    const clearance::SweepCheck zones(arm, keep_out);
    return checkPath(path, arm, solver, arm.inputAt(0.0),
                     {kPathTolerance, Eigen::VectorXd::Constant(3, kSlew), &zones});
  };
  const auto blocked = refusal(0.5 * (from + to) + Eigen::Vector3d(0.01, 0, 0));
  ASSERT_TRUE(blocked);
  EXPECT_EQ(blocked->fault, PathFault::kBlocked);
  EXPECT_LT(blocked->time, 30);
  // The arm begins straight, and passes it on its way to the first point.
  const auto before = refusal(0.5 * (arm.tip(arm.inputAt(0.0)).translation + from));
  ASSERT_TRUE(before);
  EXPECT_EQ(before->time, 0);
  EXPECT_FALSE(refusal(to + Eigen::Vector3d(0.2, 0, 0)));
}

}  // namespace
}  // namespace helix_arm::follow
