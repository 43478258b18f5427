#include "helix_arm/model/curve.hpp"

#include <Eigen/Geometry>
#include <cstdio>
#include <stdexcept>

#include <gtest/gtest.h>

#include "support/high_precision.hpp"
#include "support/paper_arm.hpp"

namespace helix_arm::model {
namespace {

Twists twist(const Eigen::Vector3d& v, const Eigen::Vector3d& w) {
  Twists g(6, 1);
  g << v, w;
  return g;
}

TEST(Curve, TenThousandSamplesDoNotDrift) {
  const Twists g = twist({0.4, 0.001, -0.002}, {4.0, 0.1, 0.5});
  const auto curve = sampleCurve(g, 10001);
  double worst = 0;
  for (std::size_t i = 1; i < curve.size(); i += 97) {
    const lie::Vector6 xi = curve[i].s * g.col(0);
    const test::RealMatrix exact = test::expOfMatrix(test::hat(xi));
    worst = std::max(worst, test::relativeEps(curve[i].X.translation, exact.topRightCorner(3, 1)));
    worst = std::max(worst, test::worstEps(curve[i].X.rotation, exact.topLeftCorner(3, 3)));
  }
  std::printf("worst of 10 001 samples: %.2f eps\n", worst);
  EXPECT_LE(worst, 8.0);
}

TEST(Curve, BeginsAtTheBaseAndEndsAtTheTip) {
  const Arm arm = test::ringArm(test::helicalRing(), 3);
  const Twists g = arm.twists(Eigen::VectorXd::LinSpaced(9, 0, 3e5));
  const auto curve = sampleCurve(g, 50);
  EXPECT_EQ(curve.front().s, 0.0);
  EXPECT_EQ(curve.back().s, 3.0);
  EXPECT_EQ(curve.front().X.translation, Eigen::Vector3d::Zero());
  EXPECT_LT((curve.back().X.translation - tipPose(g).translation).norm(), 1e-15);
  for (const auto& point : curve) {
    EXPECT_LT((point.X.translation - poseAt(g, point.s).translation).norm(), 1e-15);
  }
}

TEST(Curve, IsContinuousWhereSectionsMeet) {
  const Arm arm = test::ringArm(test::straightRing(), 2);
  const Twists g = arm.twists(Eigen::VectorXd::LinSpaced(6, 0, 3e5));
  EXPECT_LT((poseAt(g, 1 - 1e-12).translation - poseAt(g, 1).translation).norm(), 1e-11);
}

TEST(Curve, IsNotExtrapolated) {
  const Twists g = twist({0.4, 0, 0}, {0, 0, 1});
  for (const double s : {-1e-9, 1.0 + 1e-9, double(NAN)}) {
    EXPECT_THROW(poseAt(g, s), std::invalid_argument) << s;
  }
}

TEST(Curve, RefusesFewerThanTwoSamples) {
  EXPECT_THROW(sampleCurve(twist({0.4, 0, 0}, {0, 0, 1}), 1), std::invalid_argument);
}

TEST(Helix, EveryPointOfTheCurveLiesAtItsRadiusFromItsAxis) {
  const Eigen::Vector3d v(0.4, 0.03, -0.02), w(3.0, 0.4, 0.9);
  const Twists g = twist(v, w);
  const Helix helix = helixOf(g.col(0));
  const Eigen::Vector3d axis = w.normalized(), on_axis = w.cross(v) / w.squaredNorm();
  for (const auto& point : sampleCurve(g, 100)) {
    const Eigen::Vector3d from_axis = point.X.translation - on_axis;
    EXPECT_NEAR((from_axis - axis * axis.dot(from_axis)).norm(), helix.radius, 1e-14);
  }
  // After one turn the curve has advanced by the pitch.
  const Twists turn = g / helix.turns;
  EXPECT_NEAR((tipPose(turn).translation - axis * helix.pitch).norm(), 0.0, 1e-13);
}

TEST(Helix, OfAnArcHasNoPitchAndOfALineNoTurns) {
  const Helix arc = helixOf(twist({0.4, 0, 0}, {0, 0, 2}).col(0));
  EXPECT_DOUBLE_EQ(arc.radius, 0.2);
  EXPECT_EQ(arc.pitch, 0.0);
  const Helix line = helixOf(twist({0.4, 0, 0}, {0, 0, 0}).col(0));
  EXPECT_EQ(line.turns, 0.0);
  EXPECT_TRUE(std::isinf(line.radius));
  EXPECT_NEAR(helixOf(twist({0.4, 0, 0}, {0, 0, 1e-200}).col(0)).radius / 4e199, 1.0, 1e-12);
}

TEST(Curvature, LeavesTwistOut) {
  EXPECT_DOUBLE_EQ(curvatureOf(twist({0.4, 0, 0}, {5, 0.3, -0.4}).col(0)), 0.5);
}

}  // namespace
}  // namespace helix_arm::model
