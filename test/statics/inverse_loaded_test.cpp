
#include <gtest/gtest.h>

#include "helix_arm/statics/inverse.hpp"
#include "statics/arms_under_load.hpp"

namespace helix_arm::statics {
namespace {

using test::Posture;

ArmModel modelOf(const model::Arm& arm, const Load& load, Tier tier,
                 std::optional<int> order = {}) {
  return ArmModel(arm, std::nullopt, load, request(tier, order));
}

TEST(LoadedInverse, FindsInputsOfReachableTips) {
  const model::Arm arms[] = {test::softHelicalArm(), test::ringArm(test::straightRing(4)),
                             test::ringArm(test::straightRing(), 2)};
  test::Random random(31);
  for (const model::Arm& arm : arms) {
    Load load;
    load.gravity = {0, 0, -test::kGravity};
    load.mass.assign(arm.sectionCount(), 0.1);
    load.K_eps.assign(arm.sectionCount(), 1200);
    for (const int order : {2, 5}) {
      const ArmModel model = modelOf(arm, load, Tier::kLoaded, order);
      InverseSolver solver(model), linear(arm);
      int missed = 0, linear_hits = 0;
      constexpr int kTargets = 25;
      for (int i = 0; i < kTargets; ++i) {
        const Tip target = model.tip(test::randomInput(arm, random));
        ASSERT_TRUE(target.converged());
        const InverseResult& result = solver.toPosition(target.tip.translation, arm.inputAt(0.2));
        if (result.status != InverseStatus::kReached) ++missed;
        const Tip there = model.tip(result.input);
        if (result.status == InverseStatus::kReached) {
          EXPECT_LT((there.tip.translation - target.tip.translation).norm(), 1.1e-6);
        }
        const InverseResult& blind = linear.toPosition(target.tip.translation, arm.inputAt(0.2));
        const Tip off = model.tip(blind.input);
        if ((off.tip.translation - target.tip.translation).norm() < 1e-4) ++linear_hits;
      }
      EXPECT_EQ(missed, 0) << "order " << order;
      EXPECT_LE(linear_hits, 2);  // the load matters here
    }
  }
}

TEST(LoadedInverse, SaysWhereALoadKeepsTheTipFromItsTarget) {
  const model::Arm arm = test::softHelicalArm();
  const ArmModel model =
      modelOf(arm, test::weight(Posture::kHorizontal, 0.2, 900), Tier::kLoaded, 4);
  InverseSolver solver(model);
  const InverseResult& result = solver.toPosition({0.2, 0, 0.6}, arm.inputAt(0.2));
  EXPECT_EQ(result.status, InverseStatus::kUnreachable);
  EXPECT_GT(result.residual, 0.1);
  test::Random random(37);
  for (int i = 0; i < 2000; ++i) {
    const Tip tip = model.tip(test::randomInput(arm, random));
    EXPECT_GE((tip.tip.translation - Eigen::Vector3d(0.2, 0, 0.6)).norm(),
              result.position_error - 1e-5);
  }
}

TEST(LoadedInverse, ReachesPosesAndMeanTwists) {
  const model::Arm arm = test::softHelicalArm();
  const Load load = test::weight(Posture::kHorizontal, 0.2, 900);
  test::Random random(41);
  for (const auto& [tier, order] :
       {std::pair<Tier, std::optional<int>>{Tier::kLoaded, 5},
        std::pair<Tier, std::optional<int>>{Tier::kExact, std::nullopt}}) {
    const ArmModel model = modelOf(arm, load, tier, order);
    InverseSolver solver(model);
    for (int i = 0; i < 3; ++i) {
      const Eigen::VectorXd q = test::randomInput(arm, random);
      const Solution target = model.solve(q);
      EXPECT_EQ(solver.toPose(target.tip, arm.inputAt(0.5)).status, InverseStatus::kReached);
      const InverseResult& result = solver.toTwists(target.shape.twists(), arm.inputAt(0.5));
      EXPECT_EQ(result.status, InverseStatus::kReached) << result.residual;
      EXPECT_LT((model.solve(result.input).shape.twists() - target.shape.twists()).norm(), 1e-4);
      // Three muscles: the inputs that make this shape are the only ones.
      EXPECT_LT((result.input - q).cwiseAbs().maxCoeff(), 200.0);
    }
  }
}

TEST(LoadedInverse, ReportsWhereNoShapeBalancesTheLoad) {
  const model::Arm arm = test::softHelicalArm();
  const ArmModel heavy =
      modelOf(arm, test::weight(Posture::kHorizontal, 40.0, 500), Tier::kLoaded, 5);
  test::Random random(43);
  int balanced = 0, hopeless = 0;
  InverseSolver solver(heavy);
  for (int i = 0; i < 30; ++i) {
    const Tip tip = heavy.tip(test::randomInput(arm, random));
    balanced += tip.converged() ? 1 : 0;
    const Eigen::Vector3d target =
        tip.converged() ? tip.tip.translation : Eigen::Vector3d(0.2, 0.1, 0.1);
    const InverseResult& result = solver.toPosition(target, test::randomInput(arm, random));
    if (!std::isfinite(result.residual)) {
      EXPECT_EQ(result.status, InverseStatus::kNotConverged);
      ++hopeless;
    } else {
      EXPECT_TRUE(heavy.tip(result.input).converged());
    }
  }
  EXPECT_LT(balanced, 30);
  EXPECT_GT(hopeless, 0);
}

}  // namespace
}  // namespace helix_arm::statics
