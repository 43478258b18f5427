#include "statics/derivatives.hpp"

namespace helix_arm::statics {
namespace {

using namespace test;

// Without weight, so that the exact tier has the response to a load of an arm without one.
Load weightless(int sections) {
  Load load;
  load.mass.assign(static_cast<std::size_t>(sections), 0.0);
  load.K_eps.assign(static_cast<std::size_t>(sections), 900.0);
  load.K_eps.back() = 1100.0;
  return load;
}

TEST(Jacobian, WithoutLoadIsTheDerivativeByLengthsInputsStiffnessAndLoad) {
  Random random(1);
  for (const int sections : {1, 2, 3}) {
    for (const bool resists_torsion : {true, false}) {
      const model::Arm arm = variedArm(sections, 3 + sections % 2, resists_torsion, random);
      const Eigen::VectorXd q = innerInput(arm, random);
      const Load load = weightless(sections);
      expectDerivatives({std::to_string(sections) + " sections", arm, load, kLinearTier, q});
      // A potential: displacements of the tip by forces there are symmetric.
      const ShapeJacobian found =
          jacobianAt(ArmModel(arm, std::nullopt, load, kLinearTier), q, {false, true});
      EXPECT_LT((found.by_load->tip - found.by_load->tip.transpose()).norm(),
                1e-12 * found.by_load->tip.norm());
    }
  }
  const model::Arm tapered = taperedArm(0.26);
  expectDerivatives({"taper", tapered, weightless(1), kLinearTier, innerInput(tapered, random)});
  EXPECT_FALSE(jacobianAt(ArmModel(tapered), tapered.inputAt(0.4)).by_load);
}

// One muscle in the middle turns about itself as it likes.
TEST(Jacobian, IsNanWhereAnEntryWouldResistWhatNothingElseDoes) {
  Ring ring = straightRing(1);
  ring.radius = 0.0;
  const model::Arm arm = ringArm(ring);
  ASSERT_LT(arm.equilibrium(0).rank, 6);
  const Load load = weight(Posture::kHanging, 0.1, 900);
  for (const TierSetting& setting : {kLinearTier, loadedTier(5), kExactTier}) {
    const ShapeJacobian found =
        jacobianAt(ArmModel(arm, std::nullopt, load, setting), arm.inputAt(0.3));
    ASSERT_EQ(found.status, SolveStatus::kConverged);
    EXPECT_TRUE(found.by_stiffness->tip.col(0).allFinite());
    EXPECT_TRUE(found.by_stiffness->tip.col(1).array().isNaN().all());
    EXPECT_TRUE(found.by_stiffness->tip.col(2).allFinite());
  }
}

constexpr double kMostOrderError = 5e-6;  // of the mean twists

// Without load, the response to one is that of the exact tier at a vanishing load, whatever the
// load that the linear tier leaves out.
void expectResponseOfTheUnloadedArm(const model::Arm& arm, const Load& load,
                                    const Eigen::VectorXd& q, const std::string& what) {
  const ArmModel linear(arm, std::nullopt, load, kLinearTier);
  const ShapeJacobian found = jacobianAt(linear, q);
  EXPECT_EQ(found.status, SolveStatus::kConverged) << what;
  Load vanishing = load;
  vanishing.points.clear();
  for (double& mass : vanishing.mass) mass = 1e-9;
  const ArmModel exact(arm, std::nullopt, vanishing, kExactTier);
  const ShapeJacobian expected = jacobianAt(exact, q);
  ASSERT_EQ(expected.status, SolveStatus::kConverged) << what;
  ASSERT_TRUE(found.by_load) << what;
  EXPECT_LT((found.by_load->tip - expected.by_load->tip).norm(),
            kMostOrderError * expected.by_load->tip.norm())
      << what;
  EXPECT_LT((found.by_load->twists - expected.by_load->twists).norm(),
            kMostOrderError * expected.by_load->twists.norm())
      << what;
}

TEST(Jacobian, ByALoadIsThatOfTheExactTierAtAVanishingLoad) {
  const Eigen::VectorXd q = Eigen::Vector3d(1.3e5, 1.3e5, 1.0e5);
  Load load = weight(Posture::kHorizontal, 0.3, 200);
  expectResponseOfTheUnloadedArm(softHelicalArm(), load, q, "one stiffness");
  expectResponseOfTheUnloadedArm(taperedArm(), load, q, "taper");
  load.tables = {{{0, 1e5, 2e5, kMaxPressure}, {3.2, 1, 2.6, 3.7}}};
  expectResponseOfTheUnloadedArm(softHelicalArm(), load, q, "table");
}

TEST(Jacobian, ALoadThatTheTierLeavesOutDoesNotKeepItFromConverging) {
  const Load load = weight(Posture::kHorizontal, 30, 5);
  for (const model::Arm& arm : {softHelicalArm(), taperedArm()}) {
    const ShapeJacobian found =
        jacobianAt(ArmModel(arm, std::nullopt, load, kLinearTier), arm.inputAt(0.4));
    EXPECT_EQ(found.status, SolveStatus::kConverged);
    ASSERT_TRUE(found.by_load);
    EXPECT_TRUE(found.by_load->tip.allFinite());
  }
}

TEST(Jacobian, IsNanWithoutEquilibrium) {
  const ArmModel model(softHelicalArm(), std::nullopt, weight(Posture::kHorizontal, 40.0, 500),
                       loadedTier(5));
  const ShapeJacobian found = jacobianAt(model, Eigen::Vector3d(1e5, 2e5, 0));
  EXPECT_NE(found.status, SolveStatus::kConverged);
  EXPECT_TRUE(found.by_inputs.tip.array().isNaN().all());
  EXPECT_TRUE(found.by_load->twists.array().isNaN().all());
}

// Few actuators take differences, more of them linear equations.
TEST(Jacobian, OfTheTipIsNanWithoutEquilibriumInEveryTier) {
  // Nothing resists a moment about the one muscle in the middle.
  Ring ring = straightRing(1);
  ring.radius = 0.0;
  Load twisting = weight(Posture::kHanging, 0.1, 900);
  twisting.points.emplace_back();
  twisting.points.back().moment = Eigen::Vector3d(1, 0, 0);
  const Load heavy = weight(Posture::kHorizontal, 400.0, 50);
  for (const ArmModel& model :
       {ArmModel(ringArm(ring), std::nullopt, twisting, loadedTier(5)),
        ArmModel(ringArm(ring), std::nullopt, twisting, kExactTier),
        ArmModel(ringArm(helicalRing(6)), std::nullopt, heavy, loadedTier(5))}) {
    const Eigen::VectorXd lengths = model.arm().lengths(model.arm().inputAt(0.4));
    const TipResponse found = model.tipResponse(lengths);
    ASSERT_NE(found.status, SolveStatus::kConverged) << model.choice().setting.name();
    EXPECT_EQ(found.by_lengths.cols(), lengths.size());
    EXPECT_TRUE(found.by_lengths.array().isNaN().all());
  }
}

void expectSame(const ShapeDerivative& found, const ShapeDerivative& expected, double tolerance) {
  EXPECT_LE((found.tip - expected.tip).norm(), tolerance * expected.tip.norm());
  EXPECT_LE((found.twists - expected.twists).norm(), tolerance * expected.twists.norm());
}

// Under load, equations with fewer right-hand sides round otherwise.
TEST(Jacobian, WhatIsWantedDoesNotDependOnTheRest) {
  Random random(5);
  const Load load = weight(Posture::kHorizontal, 0.15, 1000);
  const std::pair<ArmModel, double> cases[] = {
      {ArmModel(variedArm(2, 4, true, random), std::nullopt, weightless(2), kLinearTier), 0.0},
      {ArmModel(taperedArm(), std::nullopt, load, kLinearTier), 0.0},
      {ArmModel(softHelicalArm(), std::nullopt, load, loadedTier(5)), 1e-12},
      {ArmModel(softHelicalArm(), std::nullopt, load, kExactTier), 1e-12}};
  for (const auto& [model, tolerance] : cases) {
    SCOPED_TRACE(model.choice().setting.name());
    const Eigen::VectorXd q = model.arm().inputAt(0.4);
    const ShapeJacobian whole = jacobianAt(model, q);
    ASSERT_EQ(whole.status, SolveStatus::kConverged);
    for (const JacobianParts wanted : {JacobianParts{false, false}, {true, false}, {false, true}}) {
      const ShapeJacobian found = jacobianAt(model, q, wanted);
      EXPECT_EQ(found.status, whole.status);
      EXPECT_EQ(found.tip.translation, whole.tip.translation);
      EXPECT_EQ(found.twists, whole.twists);
      expectSame(found.by_inputs, whole.by_inputs, tolerance);
      expectSame(found.by_lengths, whole.by_lengths, tolerance);
      ASSERT_EQ(found.by_stiffness.has_value(), wanted.by_stiffness);
      if (found.by_stiffness) expectSame(*found.by_stiffness, *whole.by_stiffness, tolerance);
      ASSERT_EQ(found.by_load.has_value(), wanted.by_load);
      if (found.by_load) expectSame(*found.by_load, *whole.by_load, tolerance);
    }
  }
}

// In the tiers without load the shape is that of the model's solution.
TEST(Jacobian, HasTheShapeOfTheSolution) {
  Random random(6);
  const model::PlanarArm planar = planarArm();
  const ArmModel in_plane(model::embed(planar), planar);
  ASSERT_EQ(in_plane.choice().setting.tier, Tier::kPlanar);
  for (const ArmModel& model :
       {ArmModel(variedArm(3, 3, true, random)), ArmModel(taperedArm()), in_plane}) {
    const Eigen::VectorXd q = randomInput(model.arm(), random);
    const ShapeJacobian found = jacobianAt(model, q, {false, false});
    const Solution expected = model.solve(q);
    EXPECT_LT((found.tip.translation - expected.tip.translation).norm(), 1e-14);
    EXPECT_LT((found.tip.rotation - expected.tip.rotation).norm(), 1e-14);
    EXPECT_LT((found.twists - expected.shape.twists()).norm(), 1e-14);
  }
}

}  // namespace
}  // namespace helix_arm::statics
