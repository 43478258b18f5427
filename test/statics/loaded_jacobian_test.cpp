// Derivatives under load against differences of tightly converged solutions, in every tier and
// order.

#include "lie/jacobian_slope.hpp"
#include "statics/derivatives.hpp"

namespace helix_arm::statics {
namespace {

TEST(LoadedJacobian, TheSlopeOfASolvedRightJacobianIsItsDerivative) {
  Random random(300);
  for (int sample = 0; sample < 300; ++sample) {
    // Both sides of the coefficients' switch, and near 0.
    const double angle = sample % 3 == 0 ? random.logUniform(1e-9, 1e-2) : random.uniform(0.1, 5.5);
    Vector6 xi, eta;
    xi << random.direction<3>(), angle * random.direction<3>();
    eta << random.direction<3>(), random.direction<3>();
    const auto checkGroup = [&](auto group, const auto& at, const auto& of) {
      using Group = decltype(group);
      const auto slope = lie::solvedRightJacobianSlope(at, of);
      for (int i = 0; i < Group::kDof; ++i) {
        typename Group::Tangent expected = Group::Tangent::Zero();
        for (const auto& [place, weight] : kCentral) {
          constexpr double kStep = 5e-3;
          const typename Group::Tangent there = at + place * kStep * Group::Tangent::Unit(i);
          expected += weight / kStep * Group::solveRightJacobian(there, of);
        }
        EXPECT_LT((slope.col(i) - expected).norm(), 1e-9 * (1.0 + slope.norm())) << angle;
      }
    };
    checkGroup(lie::SE3(), xi, eta);
    checkGroup(lie::SE2(), lie::project(xi), lie::project(eta));
  }
}

TEST(LoadedJacobian, EveryOrderAndTheExactTierAgreeWithDifferencesOfTheirOwnSolutions) {
  Random random(301);
  for (int order = kLeastOrder; order <= kMostOrder + 1; ++order) {
    const int sections = 1 + order % 2;
    const model::Arm arm = variedArm(sections, 3, true, random);
    Load load = test::randomLoad(sections, random);
    const TierSetting setting = order > kMostOrder ? kExactTier : loadedTier(order);
    expectDerivatives({setting.name(), arm, load, setting, innerInput(arm, random)});
  }
}

TEST(LoadedJacobian, HoldsForTaperedSections) {
  Random random(303);
  model::Section lower =
      test::taperedSection(test::helicalRing(), {0.05, 0.04, 0.025}, {0.0, 0.25, 0.25});
  lower.plate = 0.01;
  const model::Arm two({lower, test::ringSection(test::helicalRing(), test::fig3Muscle())});
  const model::Arm one = test::taperedArm(0.26);
  for (const TierSetting& setting : {loadedTier(2), loadedTier(5), loadedTier(7), kExactTier}) {
    Load load = test::randomLoad(1, random);
    expectDerivatives({"one, " + setting.name(), one, load, setting, innerInput(one, random)},
                      kAgreement, 1.0, 2);
    load = test::randomLoad(2, random);
    expectDerivatives({"two, " + setting.name(), two, load, setting, innerInput(two, random)},
                      kAgreement, 1.0, 3);
  }
}

TEST(LoadedJacobian, HoldsWhereTheStiffnessDependsOnThePressure) {
  Random random(304);
  const model::Arm arm = variedArm(2, 3, true, random);
  Load load = test::randomLoad(2, random);
  load.tables = {{{0, 1e5, 2e5, test::kMaxPressure}, {3.2, 1, 2.6, 3.7}}, {}};
  Eigen::VectorXd q(6);
  // Away from the kinks of the table.
  for (double& one : q) one = random.uniform(1.2e5, 1.8e5);
  for (const TierSetting& setting : {loadedTier(4), kExactTier}) {
    expectDerivatives({"table, " + setting.name(), arm, load, setting, q});
  }
}

TEST(LoadedJacobian, HoldsInThePlaneAndOutOfIt) {
  const model::PlanarArm plane = test::planarArm(2);
  const model::Arm arm = model::embed(plane);
  Load load;
  load.gravity = {1, -9, 0};
  load.mass = {0.05, 0.05};
  load.K_eps = {900, 1100};
  const Eigen::VectorXd q = arm.inputAt(Eigen::VectorXd(Eigen::Vector4d(0.2, 0.7, 0.5, 0.3)));
  ASSERT_TRUE(staysInPlane(arm, load));
  expectDerivatives({"in space", arm, load, loadedTier(5), q});
  const ArmModel planar(arm, plane, load, loadedTier(5)),
      space(arm, std::nullopt, load, loadedTier(5));
  EXPECT_EQ(jacobianAt(planar, q).by_load->tip, jacobianAt(space, q).by_load->tip);
  // The tip's response alone, solved in the plane.
  using In = ActuatorChange<lie::SE2>;
  using Space = ActuatorChange<lie::SE3>;
  const Eigen::VectorXd lengths = arm.lengths(q);
  for (const int order : {2, 5}) {
    const auto flat = PlanarLoadedArm(plane, load, order)
                          .tipBy(plane.unloadedOfLengths(lengths),
                                 In(plane, &load, lengths, In::By::kLengthsAndStiffness));
    const auto found = LoadedArm(arm, load, order)
                           .tipBy(arm.unloadedOfLengths(lengths),
                                  Space(arm, &load, lengths, Space::By::kLengthsAndStiffness));
    ASSERT_EQ(flat.by.cols(), found.by.cols());
    for (int i = 0; i < flat.by.cols(); ++i) {
      EXPECT_LT((lie::embed(lie::SE2::Tangent(flat.by.col(i))) - found.by.col(i)).norm(),
                1e-9 * (1e-3 + found.by.col(i).norm()))
          << i;
    }
  }
}

TEST(LoadedJacobian, TheResponseOfTheTipIsThatOfTheWholeJacobian) {
  Random random(305);
  const model::Arm plated = variedArm(2, 4, true, random), tapered = test::taperedArm(0.26);
  Load table = test::randomLoad(2, random);
  table.tables = {{{0, test::kMaxPressure}, {1, 3}}, {}};
  const std::pair<model::Arm, Load> cases[] = {{plated, test::randomLoad(2, random)},
                                               {plated, table},
                                               {tapered, test::randomLoad(1, random)}};
  for (const auto& [arm, load] : cases) {
    const Eigen::VectorXd q = innerInput(arm, random);
    for (const TierSetting& setting : {kLinearTier, loadedTier(2), loadedTier(5), kExactTier}) {
      // The lowest order, and few actuators, take differences.
      const bool differences = setting.order == kLeastOrder || arm.actuatorCount() < 8;
      const double tolerance = differences ? 1e-5 : 1e-9;
      const ArmModel model(arm, std::nullopt, load, setting);
      const TipResponse tip = model.tipResponse(arm.lengths(q));
      const ShapeJacobian whole = jacobianAt(model, q);
      Eigen::MatrixXd turned = tip.by_lengths;
      for (const int half : {0, 3}) {
        turned.middleRows<3>(half) = tip.tip.rotation * tip.by_lengths.middleRows<3>(half);
      }
      EXPECT_LT((turned - whole.by_lengths.tip).norm(), tolerance * turned.norm())
          << setting.name();
    }
  }
}

// A slender column under a share of Euler's load: small changes swing it far, and the errors of the
// solution and of the differences grow with that.
TEST(LoadedJacobian, HoldsNearABucklingLoad) {
  const test::Ring ring{3, 1e-3, 0.0, {1e4, 1e-5, 1e-5}};
  const model::Arm arm = test::ringArm(ring);
  constexpr double kEps = 1000.0;
  const double bending =
      kEps * ring.count * (ring.stiffness.kappa + 0.5 * ring.radius * ring.radius);
  const double critical = test::kPi * test::kPi / 4 * bending / std::pow(arm.freeLength(0), 2);
  const Eigen::VectorXd q = arm.inputAt(0.0);
  for (const double share : {0.5, 0.9, 0.97}) {
    Load load;
    load.mass = {0.0};
    load.K_eps = {kEps};
    load.points.resize(1);
    load.points[0].force = share * critical * Eigen::Vector3d(-1, 0.01, -0.02);
    for (const TierSetting& setting : {loadedTier(8), kExactTier}) {
      // Steps shrink with the distance to the branching point, where the response is not linear.
      expectDerivatives({"share " + std::to_string(share), arm, load, setting, q},
                        kAgreement / std::pow(1 - share, 1.5), 1 - share);
    }
  }
}

TEST(LoadedJacobian, ForcesAndDisplacementsAreReciprocal) {
  Random random(306);
  const model::Arm arm = variedArm(2, 3, true, random);
  Load load = test::randomLoad(2, random);
  for (PointLoad& point : load.points) point.moment.setZero();  // it has no potential
  const ArmModel model(arm, std::nullopt, load, kExactTier);
  const auto by_force =
      jacobianAt(model, innerInput(arm, random)).by_load->tip.topLeftCorner<3, 3>().eval();
  EXPECT_LT((by_force - by_force.transpose()).norm(), 1e-9 * by_force.norm());
}

}  // namespace
}  // namespace helix_arm::statics
