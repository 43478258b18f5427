#include "helix_arm/statics/exact.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/statics/loaded.hpp"
#include "statics/arms_under_load.hpp"

namespace helix_arm::statics {
namespace {

using Eigen::Vector3d;

PointLoad tipLoad(const model::Arm& arm, const Vector3d& force,
                  const Vector3d& moment = Vector3d::Zero()) {
  return {arm.sectionCount() - 1, 1.0, 0.0, force, moment};
}

model::Twists unpressurised(const model::Arm& arm) { return arm.twists(arm.inputAt(0)); }

// The straight ring's bending stiffness, summed over its muscles by hand, for K_eps = 1 [m^2].
double bendingOf(const test::Ring& ring) {
  return ring.count * (ring.stiffness.kappa + 0.5 * ring.radius * ring.radius);
}

// The elastica: an inextensible cantilever along x with a dead force F at its tip, at an angle
// beta to x. Its tip turns by theta_L < beta; with theta = theta_L - u^2 the integrals of
// EI/2 theta'^2 = F (cos(beta - theta_L) - cos(beta - theta)) are smooth.
struct Elastica {
  double force;  // F l^2 / EI
  double x, y;   // of the tip, by l
};
Elastica elastica(double beta, double theta_L) {
  const int count = 4000;  // Simpson
  double arc = 0, x = 0, y = 0;
  for (int i = 0; i <= count; ++i) {
    const double u = std::sqrt(theta_L) * i / count, a = beta - theta_L;
    const double ratio = u > 0 ? u * u / std::sin(u * u / 2) : 2.0;
    const double f = 2 * std::sqrt(0.5 * ratio / std::sin(a + u * u / 2));
    const double weight = (i == 0 || i == count ? 1
                           : i % 2              ? 4
                                                : 2) *
                          std::sqrt(theta_L) / count / 3;
    arc += weight * f;
    x += weight * f * std::cos(theta_L - u * u);
    y += weight * f * std::sin(theta_L - u * u);
  }
  return {0.5 * arc * arc, x / arc, y / arc};
}

TEST(ExactArm, LargeDeflectionsAreThoseOfTheElastica) {
  // Thin muscles on a thin ring: bending is softer than stretch and shear by 1e11.
  const test::Ring ring{3, 1e-6, 0.0, {10.0, 1e-12, 1e-12}};
  const model::Arm arm = test::ringArm(ring);
  const double l = arm.freeLength(0), K_eps = 1e12, EI = K_eps * bendingOf(ring);
  // Rounding of lengths may bend so thin a ring by 1e-16 l / radius; pi - beta is as small as 1e-5.
  model::Twists straight = unpressurised(arm);
  EXPECT_LT(straight.bottomRows(3).norm(), 1e-9);
  straight.bottomRows(3).setZero();
  for (const double beta : {test::kPi / 2, 3.0, 3.12, test::kPi - 1e-5}) {
    for (const double theta_L : {0.3, 1.0, 1.5, 2.5}) {
      if (theta_L >= beta) continue;
      const Elastica expected = elastica(beta, theta_L);
      const Eigen::AngleAxisd plane(0.7, Vector3d::UnitX());
      Load load = weightless(arm.sectionCount(), K_eps);
      load.points.push_back(tipLoad(
          arm,
          expected.force * EI / (l * l) * (plane * Vector3d(std::cos(beta), std::sin(beta), 0))));
      ExactOptions options;
      // Only sin(beta) resists turns of the plane: rounding is 1e-15 / sin(beta) of a step.
      options.tolerance = std::max(options.tolerance, 1e-15 / std::sin(beta));
      const Solution solution = ExactArm(arm, load, options).solve(straight);
      ASSERT_TRUE(solution.converged())
          << beta << " " << theta_L << " after " << solution.iterations;
      EXPECT_LT(
          (solution.tip.translation - l * (plane * Vector3d(expected.x, expected.y, 0))).norm(),
          1e-9 * l)
          << beta << " " << theta_L;
    }
  }
  // Euler's load, or the last ones above were not past buckling.
  EXPECT_GT(elastica(3.12, 1.5).force, test::kPi * test::kPi / 4);
}

// How far the strain of the curve that an arm gives, by differences of its poses, is from the one
// that the wrench calls for, by quadrature over those poses: the largest, [m] and [rad].
struct Imbalance {
  double strain = 0.0;
  double load = 0.0;  // largest strain of the load
};
Imbalance imbalance(const model::Arm& arm, const Load& load, const model::Twists& unloaded) {
  const int pieces = model::kMaxPieces / arm.sectionCount(), count = pieces * arm.sectionCount();
  const double h = 1.0 / pieces;
  ExactOptions options;
  options.pieces_per_section = pieces;
  const Solution solution = ExactArm(arm, load, options).solve(unloaded);
  EXPECT_TRUE(solution.converged());
  std::vector<lie::SE3> X(1);
  for (int i = 0; i < count; ++i) X.push_back(X[i] * lie::SE3::exp(solution.shape.pieces().col(i)));
  EXPECT_LT(apart(X.back(), solution.tip), 1e-12);

  Imbalance worst;
  lie::Vector6 W = lie::Vector6::Zero();
  for (int i = count; i > 0; i -= 2) {
    bool kink = i % pieces == 0;
    for (const PointLoad& point : load.points) {
      const double at = (point.section + point.s) * pieces;
      EXPECT_EQ(at, 2 * std::round(at / 2));  // on a node of the quadrature
      kink = kink || std::abs(at - i) < 2;
      if (at != i) continue;
      const Vector3d force = load.forceOf(point);
      W.head<3>() += force;
      W.tail<3>() += (X[i] * point.offset).cross(force) + point.moment;
    }
    const int k = (i - 1) / pieces;
    if (!kink) {
      const auto difference = [&](int j) {
        return lie::Vector6((X[i - j].inverse() * X[i + j]).log() / (2 * j * h));
      };
      const lie::Vector6 g = (4 * difference(1) - difference(2)) / 3;
      const lie::Matrix6 C = arm.freeLength(k) / load.K_eps[k] * arm.equilibrium(k).compliance;
      const lie::Vector6 strain = C * (X[i].adjoint().transpose() * W);
      worst.load = std::max(worst.load, strain.norm());
      worst.strain = std::max(worst.strain, (g - unloaded.col(k) - strain).norm());
    }
    const Vector3d f = load.mass[k] * load.gravity * h / 3;
    W.head<3>() += 6 * f;
    W.tail<3>() += (X[i].translation + 4 * X[i - 1].translation + X[i - 2].translation).cross(f);
  }
  return worst;
}

PointLoad samplePoint(int section, double s, test::Random& random) {
  // Which factor of a product draws first is the compiler's choice.
  const auto draw = [&](double least, double largest) {
    const Vector3d direction = random.direction<3>();
    return Vector3d(random.uniform(least, largest) * direction);
  };
  PointLoad point{section, s, random.uniform(0, 0.1)};
  point.force = draw(1, 2);
  point.moment = draw(0, 0.1);
  point.offset = draw(0, 0.1);
  return point;
}

TEST(ExactArm, StrainFollowsFromTheWrenchOfAllThatIsBeyond) {
  test::Random random(502);
  for (const int sections : {1, 2, 4}) {
    for (const test::Ring& ring : {test::straightRing(), test::helicalRing()}) {
      const model::Arm arm = test::ringArm(ring, sections);
      for (int i = 0; i < 4; ++i) {
        Load load = weightless(arm.sectionCount(), 1000.0);
        load.gravity = 9.81 * random.direction<3>();
        for (double& mass : load.mass) mass = random.uniform(0.1, 0.3);
        load.points = {samplePoint(sections - 1, 1.0, random), samplePoint(0, 0.5, random),
                       samplePoint(0, 0.5, random), samplePoint(sections - 1, 0.0, random)};
        const Imbalance found = imbalance(arm, load, arm.twists(test::randomInput(arm, random)));
        EXPECT_GT(found.load, 0.04);
        // The differences' own error is of order h^4.
        EXPECT_LT(found.strain, 2e-6 * std::pow(sections, 4)) << sections;
      }
    }
  }
}

TEST(ExactArm, LoadOnAMotionThatNothingResistsIsUnsupportedInEveryTier) {
  // One muscle along the axis without torsional stiffness: it bends, and spins freely.
  const test::Ring ring{1, 0.0, 0.0, {10.0, 0.0, 1e-3}};
  const model::Arm arm = test::ringArm(ring);
  ASSERT_EQ(arm.equilibrium(0).rank, 5);
  const auto expect = [&](const PointLoad& point, SolveStatus status) {
    Load load = weightless(arm.sectionCount(), 500.0);
    load.points = {point};
    EXPECT_EQ(ExactArm(arm, load).solve(unpressurised(arm)).status, status);
    EXPECT_EQ(LoadedArm(arm, load, 5).solve(unpressurised(arm)).status, status);
  };
  PointLoad bent = tipLoad(arm, {0, 0.2, -0.1});
  expect(bent, SolveStatus::kConverged);
  expect(tipLoad(arm, {0, 0, 0}, {0.01, 0, 0}), SolveStatus::kUnsupported);
  bent.offset = {0, 0.1, 0.1};  // beside the axis, the force turns it
  expect(bent, SolveStatus::kUnsupported);
}

// A column along x that hardly shortens or shears, pressed at its tip or by its own weight: Euler
// and Greenhill say where the exact tier's shape leaves the axis, and orders find that shape or say
// that they did not.
TEST(Buckling, ColumnsGiveWayAtTheirCriticalLoadsAndTiersFindTheStableShapeOrSayThatTheyDidNot) {
  const test::Ring ring{3, 1e-3, 0.0, {1e4, 1e-5, 1e-5}};
  constexpr double kEps_N = 1000.0;  // K_eps
  ExactOptions patient;              // from straight to bent is a sharp turn
  patient.max_iterations = 500;
  test::Random random(801);
  for (const auto& [name, by_weight, sections] :
       {std::tuple{"pressed at its tip", false, 1},
        {"under its own weight", true, 1},
        {"of 3 sections, under its own weight", true, 3}}) {
    const model::Arm arm = test::ringArm(ring, sections);
    const model::Twists straight = arm.twists(arm.inputAt(0));
    const double length = sections * arm.freeLength(0);
    const double EI = kEps_N * bendingOf(ring);
    const double critical =
        (by_weight ? 7.837 : test::kPi * test::kPi / 4) * EI / (length * length);
    int found_under = 0, refused_past = 0;
    for (const double share : {0.5, 0.8, 0.95, 0.99, 1.01, 1.05, 1.2, 1.5, 2.0}) {
      const double force = share * critical, angle = random.uniform(0, 2 * test::kPi);
      Load load = test::evenLoad(sections, {-test::kGravity, 0, 0},
                                 by_weight ? force / test::kGravity / sections : 0.0, kEps_N);
      load.points.assign(1, PointLoad{sections - 1});
      load.points[0].force =
          force * Vector3d(by_weight ? 0 : -1, 1e-4 * std::cos(angle), 1e-4 * std::sin(angle));
      const Solution truth = ExactArm(arm, load, patient).solve(straight);
      ASSERT_TRUE(truth.converged()) << name << " " << share;
      const double swing = truth.tip.translation.tail<2>().norm() / arm.restLength();
      EXPECT_TRUE(share < 1 ? swing < 0.05 : swing > 0.1) << name << " " << share << ": " << swing;
      for (int order = kLeastOrder; order <= kMostOrder; ++order) {
        const Solution found = LoadedArm(arm, load, order).solve(straight);
        found_under += share < 1 && found.converged();
        refused_past += share > 1 && !found.converged();
        const double off = (found.tip.translation - truth.tip.translation).norm();
        EXPECT_TRUE(!found.converged() || off < 1e-2 * arm.restLength()) << order << " " << share;
      }
    }
    EXPECT_GT(found_under, 21) << name << ": of 4 shares in 7 orders";
    EXPECT_GT(refused_past, 0) << name;
  }
}

}  // namespace
}  // namespace helix_arm::statics
