#include "helix_arm/model/arm.hpp"

#include <cmath>
#include <cstdio>
#include <stdexcept>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "support/allocation_counter.hpp"
#include "support/apart.hpp"
#include "support/expect_refusal.hpp"
#include "support/high_precision.hpp"
#include "support/linked_arm.hpp"

namespace helix_arm::model {
namespace {

TEST(Arm, TwistIsTheMapTimesTheLengths) {
  const Arm arm = test::ringArm(test::helicalRing());
  test::Random random(61);
  for (int i = 0; i < 1000; ++i) {
    const Eigen::VectorXd q = test::randomInput(arm, random);
    const lie::Vector6 expected = arm.equilibrium(0).map * arm.lengths(q);
    EXPECT_LT((arm.twists(q).col(0) - expected).norm(), 1e-13);
    EXPECT_LT((arm.twistsOfLengths(arm.lengths(q)).col(0) - expected).norm(), 1e-13);
  }
}

TEST(Arm, InflatingOneMuscleBendsTowardsIt) {
  const Arm arm = test::ringArm(test::straightRing());
  const Eigen::Vector3d tip = arm.tip(Eigen::Vector3d(3e5, 0, 0)).translation;
  EXPECT_GT(tip.y(), 0.05);  // muscle 1 sits at +y
  EXPECT_NEAR(tip.z(), 0.0, 1e-12);
}

TEST(Arm, EqualPressuresKeepAStraightArmStraight) {
  const Arm arm = test::ringArm(test::straightRing(4));
  const lie::SE3 tip = arm.tip(Eigen::Vector4d::Constant(2e5));
  EXPECT_LT(tip.translation.tail<2>().norm(), 1e-14);
  EXPECT_NEAR(tip.translation.x(), test::fig3Muscle().length(2e5), 1e-14);
}

TEST(Arm, ActuatorsMayDiffer) {
  // A tendon and a muscle in one section: each keeps its own length, stiffness and limits.
  Section section = test::ringSection(test::straightRing(), test::fig3Muscle());
  section.actuators[1].contraction = Contraction::tendon(0.42, 0.01, 5);
  section.actuators[1].limits = {0, 4};
  section.actuators[1].drive = Drive::kTendon;
  section.actuators[1].stiffness.kappa = 1e-3;
  const Arm arm({section});
  const Eigen::VectorXd l = arm.lengths(Eigen::Vector3d(1e5, 2, 0));
  EXPECT_NEAR(l[1], 0.40, 1e-15);
  test::expectRefusal<std::out_of_range>("muscle_2 is asked for 4.5",
                                         [&] { arm.tip(Eigen::Vector3d(1e5, 4.5, 0)); });
}

TEST(Arm, RefusesInputsThatBreakTheContract) {
  const Arm arm = test::ringArm(test::straightRing());
  test::expectRefusal("got 2 inputs", [&] { arm.tip(Eigen::Vector2d::Zero()); });
  for (const double bad : {-1.0, 1e6, double(NAN), double(INFINITY)}) {
    const Eigen::Vector3d q(0, bad, 0);
    test::expectRefusal<std::out_of_range>("muscle_2", [&] { arm.tip(q); });
    EXPECT_THROW(arm.twists(q), std::out_of_range);
    EXPECT_THROW(arm.lengths(q), std::out_of_range);
  }
}

TEST(Arm, ClampsInputsToTheirLimits) {
  const model::Arm arm = test::ringArm(test::straightRing());
  EXPECT_EQ(arm.clamped(Eigen::Vector3d(-1e3, 2e5, 2 * test::kMaxPressure)),
            Eigen::Vector3d(0, 2e5, test::kMaxPressure));
  EXPECT_THROW(arm.clamped(Eigen::VectorXd::Zero(2)), std::invalid_argument);
}

TEST(Arm, RefusesToBeBuiltWrong) {
  test::expectRefusal("0 sections", [] { Arm({}); });
  test::expectRefusal("17 sections", [] { test::ringArm(test::straightRing(), 17); });
  test::expectRefusal("section 1", [] { Arm({Section{}}); });
  Section section = test::ringSection(test::straightRing(), test::fig3Muscle());
  section.actuators[2].limits.upper = 1e6;
  test::expectRefusal("muscle_3 has limits", [&] { Arm({section}); });
  section = test::ringSection(test::straightRing(), test::fig3Muscle());
  section.actuators[1].stiffness.tau = -1;
  test::expectRefusal("muscle_2 has K_tau", [&] { Arm({section}); });
}

TEST(Arm, PressuresToTipDoesNotAllocate) {
  const Arm arm = test::ringArm(test::helicalRing(), 2);
  const Eigen::VectorXd q = Eigen::VectorXd::Constant(6, 1e5);
  const test::AllocationCounter counter;
  const double sum = arm.tip(q).translation.sum() + arm.twists(q).sum();
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_TRUE(std::isfinite(sum));
}

TEST(PlanarArm, AgreesWithItsEmbedding) {
  for (const PlanarArm& flat : {test::planarArm(2), test::linkedPlanarArm()}) {
    const Arm arm = embed(flat);
    test::Random random(63);
    for (int i = 0; i < 200; ++i) {
      const Eigen::VectorXd q = test::randomInput(arm, random);
      EXPECT_LT((lie::embed(flat.tip(q)).translation - arm.tip(q).translation).norm(), 1e-13);
      EXPECT_LT(test::apart(lie::embed(flat.tip(q)), arm.tip(q)), 1e-12);
      EXPECT_LT(test::apart(lie::embed(flat.tipOf(flat.twists(q))), arm.tip(q)), 1e-12);
      EXPECT_LT((embed(flat.twists(q)) - arm.twists(q)).norm(), 1e-12);
    }
  }
}

// Plates and tools: rigid links of an arm.

// The tip composed by hand.
lie::SE3 composed(const Arm& arm, const Twists& twists) {
  lie::SE3 X;
  for (int k = 0; k < arm.sectionCount(); ++k) {
    lie::Vector6 plate = lie::Vector6::Zero();
    plate[0] = test::kPlates[k];
    X = X * lie::SE3::exp(twists.col(k)) * lie::SE3::exp(plate);
  }
  return X * test::tool();
}

TEST(Links, TheTipIsTheProductOfExponentialsPlatesAndTool) {
  const Arm arm = test::linkedArm();
  test::Random random(71);
  for (int i = 0; i < 200; ++i) {
    const Eigen::VectorXd q = test::randomInput(arm, random);
    const lie::SE3 expected = composed(arm, arm.twists(q));
    EXPECT_LT(test::apart(arm.tip(q), expected), 1e-13);
    EXPECT_LT(test::apart(arm.tipOf(arm.twists(q)), expected), 1e-13);
    EXPECT_LT(test::apart(tipPose(shapeOf(arm, arm.twists(q))), expected), 1e-13);
  }
}

TEST(Links, AnArmWithoutThemHasTheSameBits) {
  const Arm plain = test::ringArm(test::helicalRing(), 2);
  Section section = test::ringSection(test::helicalRing(), test::fig3Muscle());
  section.plate = 0.0;
  const Arm zero({section, section}, lie::SE3());
  EXPECT_EQ(plain.links(), nullptr);
  EXPECT_EQ(zero.links(), nullptr);
  const Eigen::VectorXd q = plain.inputAt(0.3);
  EXPECT_EQ(plain.tip(q).translation, zero.tip(q).translation);
  EXPECT_EQ(plain.tip(q).translation, tipPose(plain.twists(q)).translation);
}

TEST(Links, SectionsBeginBeyondThePlateAndEndBeforeIt) {
  const Arm arm = test::linkedArm();
  const Shape shape = shapeOf(arm, arm.twists(arm.inputAt(0.4)));
  const lie::SE3 plate{Eigen::Matrix3d::Identity(), {test::kPlates[0], 0, 0}};
  EXPECT_LT(test::apart(poseAt(shape, 0, 1.0) * plate, poseAt(shape, 1, 0.0)), 1e-14);
  EXPECT_LT(test::apart(poseAt(shape, 1.0), poseAt(shape, 1, 0.0)), 1e-14);
  EXPECT_LT(test::apart(poseAt(shape, 1.5), poseAt(shape, 1, 0.5)), 1e-14);
  EXPECT_LT(test::apart(poseAt(shape, 1, 1.0) * arm.link(1), tipPose(shape)), 1e-13);
  const auto curve = sampleCurve(shape, 5);
  EXPECT_LT(test::apart(curve[2].X, poseAt(shape, 1, 0.0)), 1e-14);
  EXPECT_LT(test::apart(curve[4].X, poseAt(shape, 1, 1.0)), 1e-14);
  EXPECT_LT(test::apart(sampleToTip(shape, 5).back().X, tipPose(shape)), 1e-13);
  EXPECT_LT(test::apart(tipPose(shape.about(2 * shape.twists())), arm.tipOf(2 * shape.twists())),
            1e-13);
}

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

TEST(Curve, IsNotExtrapolated) {
  const Twists g = twist({0.4, 0, 0}, {0, 0, 1});
  for (const double s : {-1e-9, 1.0 + 1e-9, double(NAN)}) {
    EXPECT_THROW(poseAt(g, s), std::invalid_argument) << s;
  }
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
