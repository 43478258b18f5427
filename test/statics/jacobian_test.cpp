#include "helix_arm/statics/jacobian.hpp"

#include <algorithm>
#include <functional>
#include <string>

#include <gtest/gtest.h>

#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "support/tapered_arm.hpp"

namespace helix_arm::statics {
namespace {

using namespace test;
using lie::Vector6;

// The required agreement with differences, relative to the largest entry of the same unit.
constexpr double kAnalytic = 1e-8;
constexpr double kAngle = 3e-2;  // of the outermost differences: sixth power 1e-9 / 140 [rad]

struct There {
  lie::SE3 tip;
  Eigen::VectorXd twists;
};
using Changed = std::function<There(double change)>;

There thereOf(const Solution& solution) {
  EXPECT_TRUE(solution.converged());
  return {solution.tip, solution.shape.twists().reshaped()};
}

There thereOf(const model::Arm& arm, const Eigen::VectorXd& lengths) {
  const model::Twists twists = arm.twistsOfLengths(lengths);
  return {model::tipPose(twists), twists.reshaped()};
}

// Sixth order, of tip (velocities in the base frame) and twists.
std::pair<Vector6, Eigen::VectorXd> difference(const Changed& at, double step) {
  constexpr double kWeights[] = {0.75, -0.15, 1.0 / 60};
  const There here = at(0.0);
  Vector6 tip = Vector6::Zero();
  Eigen::VectorXd twists = Eigen::VectorXd::Zero(here.twists.size());
  for (int i = 1; i <= 3; ++i) {
    const There above = at(i * step), below = at(-i * step);
    const double weight = kWeights[i - 1] / step;
    tip.head<3>() += weight * (above.tip.translation - below.tip.translation);
    // Angles as rotation vectors about the base's axes, from the orientation here.
    const auto turn = [&here](const There& there) -> Eigen::Vector3d {
      const lie::SE3 turned{there.tip.rotation * here.tip.rotation.transpose(),
                            Eigen::Vector3d::Zero()};
      return turned.log().tail<3>();
    };
    tip.tail<3>() += weight * (turn(above) - turn(below));
    twists += weight * (above.twists - below.twists);
  }
  return {tip, twists};
}

// Compares a column with differences, relative to the largest column.
// @param most  largest step [of the quantity].
void expectColumn(const ShapeDerivative& derivative, int column, const Changed& at, double most,
                  double tolerance, const std::string& what) {
  const double angle = std::max(derivative.tip.col(column).tail<3>().norm(),
                                derivative.tip.col(column).head<3>().norm() / 0.4);
  const auto [tip, twists] = difference(at, std::min(most, kAngle / 3 / angle));
  for (const int first : {0, 3}) {
    const double size = derivative.tip.middleRows<3>(first).colwise().norm().maxCoeff();
    EXPECT_LT((derivative.tip.col(column).segment<3>(first) - tip.segment<3>(first)).norm(),
              tolerance * size)
        << what << ", tip, from row " << first;
  }
  EXPECT_LT((derivative.twists.col(column) - twists).norm(),
            tolerance * derivative.twists.colwise().norm().maxCoeff())
      << what << ", twists";
}

double& entry(model::Stiffness& stiffness, int component) {
  return component == 0 ? stiffness.gamma : component == 1 ? stiffness.tau : stiffness.kappa;
}

model::Arm restiffened(const model::Arm& arm, int actuator, int component, double change) {
  std::vector<model::Section> sections(static_cast<std::size_t>(arm.sectionCount()));
  for (int k = 0; k < arm.sectionCount(); ++k) {
    for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
      model::Actuator actuator_there = arm.actuator(i);
      if (i == actuator) entry(actuator_there.stiffness, component) += change;
      sections[static_cast<std::size_t>(k)].actuators.push_back(actuator_there);
    }
  }
  return model::Arm(sections);
}

// Rings whose sections and actuators all differ.
model::Arm variedArm(int sections, int count, bool resists_torsion, Random& random) {
  std::vector<model::Section> parts;
  for (int k = 0; k < sections; ++k) {
    Ring ring = helicalRing(count);
    ring.tilt = random.uniform(-0.3, 0.3);
    model::Section section = ringSection(ring, fig3Muscle());
    for (model::Actuator& actuator : section.actuators) {
      actuator.stiffness = {random.uniform(5, 50),
                            resists_torsion ? random.uniform(1e-5, 1e-4) : 0.0,
                            random.uniform(5e-5, 2e-4)};
    }
    parts.push_back(section);
  }
  return model::Arm(parts);
}

TEST(Jacobian, WithoutLoadIsTheDerivativeByInputsAndLengths) {
  Random random(1);
  for (const int sections : {1, 2, 3}) {
    const model::Arm arm = variedArm(sections, 3 + sections, sections == 2, random);
    const ArmModel model(arm);
    for (int sample = 0; sample < 5; ++sample) {
      const Eigen::VectorXd q = arm.clamped(0.8 * randomInput(arm, random).array() + 3e4);
      const ShapeJacobian found = jacobianAt(model, q);
      const Eigen::VectorXd lengths = arm.lengths(q);
      for (int i = 0; i < arm.actuatorCount(); ++i) {
        expectColumn(
            found.by_lengths, i,
            [&](double change) {
              Eigen::VectorXd there = lengths;
              there[i] += change;
              return thereOf(arm, there);
            },
            1e-3, kAnalytic, "length");
        expectColumn(
            found.by_inputs, i,
            [&](double change) {
              Eigen::VectorXd there = lengths;
              // The polynomial itself, so that steps may leave the limits.
              there[i] = arm.actuator(i).contraction.lengthInside(q[i] + change);
              return thereOf(arm, there);
            },
            3e3, kAnalytic, "pressure");
      }
    }
  }
}

TEST(Jacobian, WithoutLoadIsTheDerivativeByEveryEntryOfTheStiffness) {
  Random random(2);
  for (const bool resists_torsion : {true, false}) {
    const model::Arm arm = variedArm(2, 4, resists_torsion, random);
    const Eigen::VectorXd q = randomInput(arm, random);
    const ShapeJacobian found = jacobianAt(ArmModel(arm), q);
    for (int i = 0; i < arm.actuatorCount(); ++i) {
      for (const int component : {0, 1, 2}) {
        model::Stiffness own = arm.actuator(i).stiffness;
        if (!(entry(own, component) > 0)) continue;
        const double step = 0.01 * entry(own, component);
        const auto [tip, twists] = difference(
            [&](double change) {
              return thereOf(restiffened(arm, i, component, change), arm.lengths(q));
            },
            step);
        const int column = 3 * i + component;
        const double size = std::max(twists.norm(), 1e-3 / entry(own, component));
        EXPECT_LT((found.by_stiffness->tip.col(column) - tip).norm(), kAnalytic * size);
        EXPECT_LT((found.by_stiffness->twists.col(column) - twists).norm(), kAnalytic * size);
      }
    }
  }
}

// One muscle in the middle turns about itself as it likes.
TEST(Jacobian, IsNanWhereAnEntryWouldResistWhatNothingElseDoes) {
  Ring ring = straightRing(1);
  ring.radius = 0.0;
  const model::Arm arm = ringArm(ring);
  ASSERT_LT(arm.equilibrium(0).rank, 6);
  const ShapeJacobian found =
      jacobianAt(ArmModel(arm), Eigen::VectorXd(Eigen::VectorXd::Constant(1, 1e5)));
  EXPECT_TRUE(found.by_stiffness->tip.col(0).allFinite());
  EXPECT_TRUE(found.by_stiffness->tip.col(1).array().isNaN().all());
  EXPECT_TRUE(found.by_stiffness->tip.col(2).allFinite());
}

TEST(Jacobian, ByALoadIsTheDerivativeOfTheExactShape) {
  Random random(3);
  for (const int sections : {1, 2}) {
    const model::Arm arm = variedArm(sections, 3, true, random);
    Load load;
    load.mass.assign(static_cast<std::size_t>(sections), 0.0);
    load.K_eps.assign(static_cast<std::size_t>(sections), 900.0);
    load.K_eps.back() = 1100.0;
    const ArmModel model(arm, std::nullopt, load);
    ASSERT_FALSE(takesLoad(model.choice().setting.tier));
    const Eigen::VectorXd q = randomInput(arm, random);
    const ShapeJacobian found = jacobianAt(model, q);
    ASSERT_TRUE(found.by_load);
    for (int j = 0; j < 6; ++j) {
      expectColumn(
          *found.by_load, j,
          [&](double change) {
            Load with = load;
            with.points.emplace_back();
            with.points.back().section = sections - 1;
            (j < 3 ? with.points.back().force : with.points.back().moment)[j % 3] = change;
            return thereOf(ExactArm(arm, with).solve(arm.twists(q)));
          },
          0.1, kAnalytic, "load " + std::to_string(j));
    }
    // A potential: displacements of the tip by forces there are symmetric.
    EXPECT_LT((found.by_load->tip - found.by_load->tip.transpose()).norm(),
              1e-12 * found.by_load->tip.norm());
  }
}

constexpr double kMostOrderError = 5e-6;  // of the mean twists

// Without load, the response to one is that of the exact tier at a vanishing load, whatever the
// load that the linear tier leaves out.
void expectResponseOfTheUnloadedArm(const model::Arm& arm, const Load& load,
                                    const Eigen::VectorXd& q, const std::string& what) {
  const ArmModel linear(arm, std::nullopt, load, TierSetting{Tier::kLinear, 0});
  const ShapeJacobian found = jacobianAt(linear, q);
  EXPECT_EQ(found.status, SolveStatus::kConverged) << what;
  Load vanishing = load;
  vanishing.points.clear();
  for (double& mass : vanishing.mass) mass = 1e-9;
  const ArmModel exact(arm, std::nullopt, vanishing, TierSetting{Tier::kExact, 0});
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
    const ShapeJacobian found = jacobianAt(
        ArmModel(arm, std::nullopt, load, TierSetting{Tier::kLinear, 0}), arm.inputAt(0.4));
    EXPECT_EQ(found.status, SolveStatus::kConverged);
    ASSERT_TRUE(found.by_load);
    EXPECT_TRUE(found.by_load->tip.allFinite());
  }
}

TEST(Jacobian, UnderLoadIsTheDerivativeOfTheTiersShapes) {
  Random random(4);
  const model::Arm arm = softHelicalArm();
  for (const TierSetting setting : {TierSetting{Tier::kLoaded, 5}, TierSetting{Tier::kExact, 0}}) {
    const Load load = weight(Posture::kHorizontal, 0.15, 1000);
    const ArmModel model(arm, std::nullopt, load, setting);
    const Eigen::VectorXd q = randomInput(arm, random);
    const ShapeJacobian found = jacobianAt(model, q);
    ASSERT_EQ(found.status, SolveStatus::kConverged);
    const Eigen::VectorXd lengths = arm.lengths(q);
    for (int i = 0; i < 3; ++i) {
      expectColumn(
          found.by_lengths, i,
          [&](double change) {
            Eigen::VectorXd there = lengths;
            there[i] += change;
            return thereOf(model.solveLengths(there));
          },
          1e-3, kAnalytic, "length");
      expectColumn(
          *found.by_stiffness, 3 * i + 2,
          [&](double change) {
            return thereOf(ArmModel(restiffened(arm, i, 2, change), std::nullopt, load, setting)
                               .solveLengths(lengths));
          },
          0.01 * arm.actuator(i).stiffness.kappa, kAnalytic, "K_kappa");
      expectColumn(
          *found.by_load, i,
          [&](double change) {
            Load with = load;
            with.points.emplace_back();
            with.points.back().force[i] = change;
            return thereOf(ArmModel(arm, std::nullopt, with, setting).solveLengths(lengths));
          },
          0.1, kAnalytic, "force");
    }
  }
}

TEST(Jacobian, IsNanWithoutEquilibrium) {
  const ArmModel model(softHelicalArm(), std::nullopt, weight(Posture::kHorizontal, 40.0, 500),
                       TierSetting{Tier::kLoaded, 5});
  const ShapeJacobian found = jacobianAt(model, Eigen::Vector3d(1e5, 2e5, 0));
  EXPECT_NE(found.status, SolveStatus::kConverged);
  EXPECT_TRUE(found.by_inputs.tip.array().isNaN().all());
  EXPECT_TRUE(found.by_load->twists.array().isNaN().all());
}

// Few actuators take differences, more of them linear equations.
TEST(Jacobian, OfTheTipIsNanWithoutEquilibriumInEveryTier) {
  const TierSetting order5{Tier::kLoaded, 5}, exact{Tier::kExact, 0};
  // Nothing resists a moment about the one muscle in the middle.
  Ring ring = straightRing(1);
  ring.radius = 0.0;
  Load twisting = weight(Posture::kHanging, 0.1, 900);
  twisting.points.emplace_back();
  twisting.points.back().moment = Eigen::Vector3d(1, 0, 0);
  const Load heavy = weight(Posture::kHorizontal, 400.0, 50);
  for (const ArmModel& model : {ArmModel(ringArm(ring), std::nullopt, twisting, order5),
                                ArmModel(ringArm(ring), std::nullopt, twisting, exact),
                                ArmModel(ringArm(helicalRing(6)), std::nullopt, heavy, order5)}) {
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
  Load two_sections;
  two_sections.mass = {0.0, 0.0};
  two_sections.K_eps = {900.0, 1100.0};
  const TierSetting linear{Tier::kLinear, 0};
  const std::pair<ArmModel, double> cases[] = {
      {ArmModel(variedArm(2, 4, true, random), std::nullopt, two_sections, linear), 0.0},
      {ArmModel(taperedArm(), std::nullopt, load, linear), 0.0},
      {ArmModel(softHelicalArm(), std::nullopt, load, TierSetting{Tier::kLoaded, 5}), 1e-12},
      {ArmModel(softHelicalArm(), std::nullopt, load, TierSetting{Tier::kExact, 0}), 1e-12}};
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

TEST(Jacobian, WithoutTheColumnsOfALoadTheOthersAreTheSame) {
  const model::Arm arm = softHelicalArm();
  const Load load = weight(Posture::kHorizontal, 0.15, 1000);
  const Eigen::VectorXd lengths = arm.lengths(arm.inputAt(0.4));
  const ActuatorChange<lie::SE3> change(arm, &load, lengths,
                                        ActuatorChange<lie::SE3>::By::kLengths);
  const model::Unloaded unloaded = arm.unloadedOfLengths(lengths);
  const auto expectSame = [&](const auto& solver) {
    const ShapeDerivative with = solver.differentiate(unloaded, change).by;
    const ShapeDerivative without = solver.differentiate(unloaded, change, false).by;
    ASSERT_EQ(without.tip.cols(), 3);
    ASSERT_EQ(with.tip.cols(), 9);
    EXPECT_LT((with.tip.leftCols<3>() - without.tip).norm(), 1e-12 * without.tip.norm());
    EXPECT_LT((with.twists.leftCols<3>() - without.twists).norm(), 1e-12 * without.twists.norm());
  };
  expectSame(LoadedArm(arm, load, 5));
  expectSame(ExactArm(arm, load));
}

}  // namespace
}  // namespace helix_arm::statics
