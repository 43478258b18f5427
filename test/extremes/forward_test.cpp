// Whole arms at the ends of their parameters, against their definitions in 80 digits.

#include "extremes/extreme_arm.hpp"
#include "extremes/family.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "support/high_precision_arm.hpp"

namespace helix_arm::model {
namespace {

using namespace test;

double lengthOf(const Twists& twists) {
  double length = 0;
  for (int k = 0; k < twists.cols(); ++k) length += twists.col(k).head<3>().stableNorm();
  return length;
}
double turnOf(const Twists& twists) {
  double turn = 0;
  for (int k = 0; k < twists.cols(); ++k) turn += twists.col(k).tail<3>().stableNorm();
  return turn;
}

// How far the muscles of an arm would turn it, pulling one by one: what cancels where it is
// straight [rad].
double effortOf(const Arm& arm, const Eigen::VectorXd& q) {
  const Eigen::VectorXd lengths = arm.lengths(q);
  double effort = 0;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    effort += turnOf(arm.twistsOfLengths(lengths[i] * Eigen::VectorXd::Unit(lengths.size(), i)));
  }
  return effort;
}

// Error of a pose, its place by the arm's length, in eps for each radian of `turn`.
double poseError(const lie::SE3& X, const RealMatrix& reference, double length, double turn) {
  const double rotation = test::worstEps(X.rotation, reference.topLeftCorner(3, 3));
  const RealMatrix miss = X.translation.cast<Real>() - reference.topRightCorner(3, 1);
  const double place = static_cast<double>(Real(miss.norm() / length / kEps));
  return std::max(rotation, place) / (1 + turn);
}

constexpr double kForwardEps = 16;
constexpr const char* kUnit = "eps a radian";

// @param lever  at which the only muscle sits: it turns the arm by its length over that, but for
// what the least norm takes away; 0 where others hold it [m].
void expectForward(const BuildFamily& family, const RealMatrix& N, int rank, double lever = 0) {
  Family curves(std::string("curve, ") + family.range, kForwardEps, kUnit);
  Family tips(std::string("tip, ") + family.range, kForwardEps, kUnit);
  test::Random random(702);
  for (const Build& build : family.builds) {
    const Arm arm = build.arm();
    for (int k = 0; k < arm.sectionCount(); ++k) {
      ASSERT_EQ(arm.equilibrium(k).rank, rank) << build.name();
    }
    for (int i = 0; i < 6; ++i) {
      const Eigen::VectorXd q = i < 2 ? arm.inputAt(i) : test::randomInput(arm, random);
      const Twists twists = arm.twists(q);
      const RealMatrix expected = test::twistsByDefinition(arm, q, N);
      const double length = lengthOf(twists);
      const double effort = lever > 0 ? length / lever : effortOf(arm, q);
      tips.add(poseError(arm.tip(q), test::poseByDefinition(expected, arm.sectionCount()), length,
                         effort),
               build.name());
      if (i < 4) continue;
      for (const double s : {random.uniform(0, arm.sectionCount()), 1.0}) {
        curves.add(
            poseError(poseAt(twists, s), test::poseByDefinition(expected, s), length, effort),
            text("s = %.17g, %s", s, build.name().c_str()));
      }
    }
  }
}

TEST(Extremes, ForwardOfWholeArms) {
  for (const BuildFamily& family : test::extremeBuilds()) {
    expectForward(family, RealMatrix::Zero(6, 0), 6);
  }
}

TEST(Extremes, ForwardOfArmsThatAMotionCostsNothing) {
  std::vector<Build> centred, bare, aside;
  for (const int sections : {1, 4, 16}) {
    for (const double gamma : {1.0, 10.0, 1e12}) {
      for (const double length : {1e-3, 0.43, 10.0}) {
        centred.push_back({{1, 0.0, 0.0, {gamma, 0.0, 1e-4}}, sections, length});
        bare.push_back({{1, 0.0, 0.0, {gamma, 0.0, 0.0}}, sections, length});
        aside.push_back({{1, 0.0254, 0.0, {gamma, 0.0, 1e-4}}, sections, length});
      }
    }
  }
  RealMatrix turns = RealMatrix::Zero(6, 3), spin = RealMatrix::Zero(6, 1);
  turns.bottomRows(3).setIdentity();
  expectForward({"one centred muscle, K_tau = 0, rank 5", centred}, turns.leftCols(1), 5);
  expectForward({"one centred muscle, K_tau = K_kappa = 0, rank 3", bare}, turns, 3);
  // About the muscle's own axis: v = p x w.
  spin(2, 0) = -Real(0.0254);
  spin(3, 0) = 1;
  expectForward({"one muscle aside, K_tau = 0, rank 5", aside}, spin / spin.norm(), 5, 0.0254);
}

}  // namespace
}  // namespace helix_arm::model
