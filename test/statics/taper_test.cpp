// Tapered sections in every tier.
#include <gtest/gtest.h>

#include "helix_arm/statics/correction.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "statics/arms_under_load.hpp"

namespace helix_arm::statics {
namespace {

TEST(TaperedTiers, WithoutLoadTheClosedFormIsTheExactTier) {
  for (const double tilt : {0.0, kTilt}) {
    const model::Arm arm = test::taperedArm(tilt);
    // A load far too small to see: the exact tier integrates all the same.
    Load load = test::weight(test::Posture::kHorizontal, 1e-9, 900);
    const ExactArm exact(arm, load);
    test::Random random(95);
    for (int i = 0; i < 10; ++i) {
      const Eigen::VectorXd q = test::randomInput(arm, random);
      const Solution reference = exact.solve(arm.unloaded(q));
      ASSERT_TRUE(reference.converged());
      EXPECT_LT((arm.tip(q).translation - reference.tip.translation).norm(),
                1e-5 * arm.restLength());
    }
  }
}

TEST(TaperedTiers, TwistsAloneAreRefused) {
  const model::Arm arm = test::taperedArm();
  const Load load = test::weight(test::Posture::kHorizontal, 0.1, 900);
  const model::Twists twists = arm.twists(arm.inputAt(0.5));
  EXPECT_THROW(LoadedArm(arm, load, 5).solve(twists), std::invalid_argument);
  EXPECT_THROW(ExactArm(arm, load).solve(twists), std::invalid_argument);
  EXPECT_THROW(InverseSolver{arm}, std::invalid_argument);
  EXPECT_THROW(CorrectedModel(arm, nullptr), std::invalid_argument);
}

TEST(TaperedTiers, TheInverseCloses) {
  const ArmModel model(test::taperedArm(kTilt));
  InverseSolver solver(model);
  test::Random random(99);
  for (int i = 0; i < 10; ++i) {
    const Eigen::Vector3d target =
        model.tip(test::randomInput(model.arm(), random)).tip.translation;
    const InverseResult& found = solver.toPosition(target, model.arm().inputAt(0.5));
    EXPECT_EQ(found.status, InverseStatus::kReached);
    EXPECT_LT((model.tip(found.input).tip.translation - target).norm(), 1e-5);
  }
  const Eigen::VectorXd q = model.arm().inputAt(Eigen::VectorXd(Eigen::Vector3d(0.7, 0.2, 0.4)));
  const InverseResult& twists =
      solver.toTwists(model.solve(q).shape.twists(), model.arm().inputAt(0.5));
  EXPECT_EQ(twists.status, InverseStatus::kReached);
}

TEST(TaperedTiers, ACorrectionMovesTheMeanTwists) {
  const ArmModel model(test::taperedArm());
  CorrectedModel corrected(model);
  Correction correction(model.arm());
  correction.offset(4, 0) = 0.1;
  corrected.set(correction);
  const Eigen::VectorXd q = model.arm().inputAt(0.3);
  const auto shape = corrected.shape(model.arm().lengths(q));
  ASSERT_TRUE(shape);
  EXPECT_GT(shape->piecesPerSection(), 1);
  EXPECT_NEAR(shape->twists()(4, 0), model.solve(q).shape.twists()(4, 0) + 0.1, 1e-12);
}

}  // namespace
}  // namespace helix_arm::statics
