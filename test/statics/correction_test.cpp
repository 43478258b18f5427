#include "helix_arm/statics/correction.hpp"

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "support/allocation_counter.hpp"
#include "support/loaded_arm.hpp"
#include "support/paper_arm.hpp"

namespace helix_arm::statics {
namespace {

using model::Arm;

ArmModel loadedModel() {
  return ArmModel(test::softHelicalArm(), std::nullopt,
                  test::weight(test::Posture::kHanging, 0.2, 900.0), TierSetting{Tier::kLoaded, 5});
}

Correction randomCorrection(const Arm& arm, test::Random& random) {
  Correction out(arm);
  for (double& entry : out.offset.reshaped()) entry = 0.003 * random.normal();
  out.stiffness_factors = {random.logUniform(0.6, 1.6), 1.0, random.logUniform(0.6, 1.6)};
  out.K_eps_factor = random.logUniform(0.8, 1.25);
  for (double& scale : out.length_scale) scale = random.uniform(0.98, 1.02);
  return out;
}

// The same in plain words: an arm with this stiffness, these lengths, and twists moved by the
// offset.
model::Twists expectedTwists(const Arm& arm, const Correction& correction,
                             const Eigen::VectorXd& input) {
  const Arm other = arm.scaledStiffness(correction.stiffness_factors);
  return other.twistsOfLengths(correction.length_scale.cwiseProduct(arm.lengths(input))) +
         correction.offset;
}

const Arm kArms[] = {test::ringArm(test::helicalRing()), test::ringArm(test::straightRing(4)),
                     test::ringArm(test::helicalRing(), 2), model::embed(test::planarArm())};

TEST(Correct, BringsTheCorrectedArmToTheTargetAndToItsTwists) {
  test::Random random(2);
  for (const Arm& arm : kArms) {
    InverseSolver solver(arm);
    for (int k = 0; k < 100; ++k) {
      const Correction correction = randomCorrection(arm, random);
      const model::Twists target = expectedTwists(arm, correction, test::randomInput(arm, random));
      const Eigen::Vector3d tip = model::tipPose(target).translation;
      solver.correct(correction);
      const InverseResult position = solver.toPosition(tip, arm.inputAt(0.5));
      ASSERT_EQ(position.status, InverseStatus::kReached) << k;
      const lie::SE3 reached = model::tipPose(expectedTwists(arm, correction, position.input));
      ASSERT_LE((reached.translation - tip).norm(), 2e-6) << k;
      const InverseResult twists = solver.toTwists(target, arm.inputAt(0.5));
      ASSERT_EQ(twists.status, InverseStatus::kReached) << k;
      ASSERT_LE((expectedTwists(arm, correction, twists.input) - target).norm(), 3e-5) << k;
    }
  }
}

// The shape of a loaded arm with other stiffness is that of a model made for it.
TEST(CorrectedModel, AppliesTheFactorsUnderLoad) {
  const ArmModel nominal = loadedModel();
  CorrectedModel corrected(nominal);
  Correction correction(nominal.arm());
  correction.stiffness_factors = {0.7, 1.0, 1.3};
  correction.K_eps_factor = 0.9;
  corrected.set(correction);
  Load load = *nominal.load();
  load.K_eps[0] *= 0.9;
  const ArmModel other(nominal.arm().scaledStiffness({0.7, 1.0, 1.3}), std::nullopt, load,
                       nominal.choice().setting);
  const Eigen::VectorXd input = nominal.arm().inputAt(0.4);
  const auto shape = corrected.shape(nominal.arm().lengths(input));
  ASSERT_TRUE(shape);
  EXPECT_LE((shape->pieces() - other.solve(input).shape.pieces()).norm(), 1e-14);
}

TEST(CorrectedModel, GivesItsDerivatives) {
  test::Random random(5);
  const ArmModel models[] = {ArmModel(kArms[0]), ArmModel(kArms[2]), loadedModel()};
  for (const ArmModel& nominal : models) {
    const Arm& arm = nominal.arm();
    const bool loaded = takesLoad(nominal.choice().setting.tier);
    CorrectedModel corrected(nominal);
    corrected.set(randomCorrection(arm, random));
    const Eigen::VectorXd lengths = arm.lengths(arm.inputAt(0.4));
    Eigen::MatrixXd by_lengths, tip_by_lengths;
    lie::SE3 tip;
    corrected.twistsByLengths(lengths, by_lengths);
    ASSERT_TRUE(corrected.tipByLengths(lengths, tip, tip_by_lengths));
    for (int i = 0; i < arm.actuatorCount(); ++i) {
      const double step = 1e-6;
      const Eigen::VectorXd move = step * Eigen::VectorXd::Unit(arm.actuatorCount(), i);
      const auto above = corrected.shape(lengths + move), below = corrected.shape(lengths - move);
      const Eigen::VectorXd expected = (above->twists() - below->twists()).reshaped() / (2 * step);
      EXPECT_LE((by_lengths.col(i) - expected).norm(), 1e-4 * expected.norm()) << i;
      const lie::Vector6 motion =
          (model::tipPose(*below).inverse() * model::tipPose(*above)).log() / (2 * step);
      // Under load the tip moves as the uncorrected one does.
      const double allowed = loaded ? 0.05 : 1e-4;
      EXPECT_LE((tip_by_lengths.col(i) - motion).norm(), allowed * motion.norm()) << i;
    }
  }
}

TEST(CorrectedModel, AllocatesNothingWhereOnlyOffsetAndLengthsChange) {
  const Arm& arm = kArms[0];
  InverseSolver solver(arm);
  test::Random random(6);
  Correction correction = randomCorrection(arm, random);
  solver.correct(correction);
  const Eigen::Vector3d target = arm.tip(arm.inputAt(0.5)).translation;
  const Eigen::VectorXd start = arm.inputAt(0.4);
  solver.toPosition(target, start);
  const test::AllocationCounter counter;
  for (int k = 0; k < 100; ++k) {
    correction.offset(4, 0) += 1e-5;
    correction.length_scale[0] += 1e-6;
    solver.correct(correction);
    solver.toPosition(target, start);
  }
  EXPECT_EQ(counter.count(), 0u);
}

}  // namespace
}  // namespace helix_arm::statics
