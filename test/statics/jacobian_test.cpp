// Derivatives of an arm against differences of tightly converged solutions, in any tier.
#include "helix_arm/statics/jacobian.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"
#include "statics/arms_under_load.hpp"

namespace helix_arm::statics {
namespace {

using lie::Vector6;
using test::Random;

constexpr double kAgreement = 1e-8;  // relative to the largest column of the same kind
// Of one step of the differences [rad], which the exact tier's tolerance makes longer.
constexpr double kAngle = 4e-3, kLeastAngle = 5e-4, kExactAngle = 1e-2;
constexpr double kRounding = 1e-13;  // of solutions [m, rad]
constexpr double kEntryStep = 0.01;  // of an entry of the stiffness, relative to it

TierSetting loadedTier(int order) { return {Tier::kLoaded, order}; }
constexpr TierSetting kExactTier{Tier::kExact, 0}, kLinearTier{Tier::kLinear, 0};

struct There {
  lie::SE3 tip;
  Eigen::VectorXd twists;
};

// A loaded arm, its free lengths and a tier.
struct Case {
  std::string name;
  model::Arm arm;
  Load load;
  TierSetting setting;
  Eigen::VectorXd q;

  // Solved to the last digits: by a last step of Newton's method, or with the finest tolerance.
  There at(const model::Arm& there, const Load& under, const Eigen::VectorXd& lengths) const {
    const model::Unloaded unloaded = unloadedUnderOfLengths(there, under, lengths);
    Solution found;
    if (setting.tier == Tier::kLinear) {
      found = ArmModel(there, std::nullopt, under, setting).solveLengths(lengths);
    } else if (setting.tier == Tier::kExact) {
      ExactOptions options;
      options.tolerance = 1e-13;
      found = ExactArm(there, under, options).solve(unloaded);
    } else {
      const ActuatorChange<lie::SE3> change(there, &under, lengths,
                                            ActuatorChange<lie::SE3>::By::kLengths);
      found = LoadedArm(there, under, setting.order).differentiate(unloaded, change).at;
    }
    EXPECT_TRUE(found.converged()) << name;
    return {found.tip, found.shape.twists().reshaped()};
  }
};

using Changed = std::function<There(double change)>;

// One column by differences: velocity and angular velocity of the tip, base frame; twists.
struct Column {
  Vector6 tip;
  Eigen::VectorXd twists;
};

Column columnFrom(const std::vector<std::pair<double, double>>& terms, const Changed& at,
                  double step) {
  const There here = at(0.0);
  Column out{Vector6::Zero(), Eigen::VectorXd::Zero(here.twists.size())};
  for (const auto& [place, weight] : terms) {
    const There there = at(place * step);
    const lie::SE3 turned{there.tip.rotation * here.tip.rotation.transpose(),
                          Eigen::Vector3d::Zero()};
    out.tip.head<3>() += weight / step * (there.tip.translation - here.tip.translation);
    out.tip.tail<3>() += weight / step * turned.log().tail<3>();
    out.twists += weight / step * (there.twists - here.twists);
  }
  return out;
}

// Of sixth order.
const std::vector<std::pair<double, double>> kCentral = {
    {-3, -1.0 / 60}, {-2, 0.15}, {-1, -0.75}, {1, 0.75}, {2, -0.15}, {3, 1.0 / 60}};
// Of an entry that cannot be less.
const std::vector<std::pair<double, double>> kForward = {{1, 6},     {2, -7.5}, {3, 20.0 / 3},
                                                         {4, -3.75}, {5, 1.2},  {6, -1.0 / 6}};

double largest(const Eigen::MatrixXd& by, const std::vector<int>& columns, int row, int period) {
  double out = 0.0;
  for (const int column : columns) {
    double square = 0.0;
    for (Eigen::Index r = row; r < by.rows(); r += period) {
      square += by.col(column).segment<3>(r).squaredNorm();
    }
    out = std::max(out, std::sqrt(square));
  }
  return out;
}

// Compares a column with differences, relative to the largest of `alike` columns, in metres and in
// radians. Columns that vanish are as good as the solutions are.
// @param step  of the differences.
void expectColumn(const ShapeDerivative& by, int column, const std::vector<int>& alike,
                  const Column& expected, double tolerance, double step, const std::string& what) {
  const double noise = kRounding / step;
  for (const int row : {0, 3}) {
    EXPECT_LT((by.tip.col(column) - expected.tip).segment<3>(row).norm(),
              tolerance * largest(by.tip, alike, row, 6) + noise)
        << what << " " << column << ", tip, row " << row;
    double square = 0.0;
    for (Eigen::Index r = row; r < by.twists.rows(); r += 6) {
      square += (by.twists.col(column) - expected.twists).segment<3>(r).squaredNorm();
    }
    EXPECT_LT(std::sqrt(square), tolerance * largest(by.twists, alike, row, 6) + noise)
        << what << " " << column << ", twists, row " << row;
  }
}

double stepOf(const ShapeDerivative& by, int column, double size, double angle) {
  double turn =
      std::max(by.tip.col(column).tail<3>().norm(), by.tip.col(column).head<3>().norm() / size);
  for (Eigen::Index r = 3; r < by.twists.rows(); r += 6) {
    turn = std::max(turn, by.twists.col(column).segment<3>(r).norm());
  }
  return angle / turn;
}

double& entry(model::Stiffness& stiffness, int component) {
  return component == 0 ? stiffness.gamma : component == 1 ? stiffness.tau : stiffness.kappa;
}

// Forces and moments at the tip. The linear tier has the response of the exact one to them.
void expectLoadColumns(const Case& c, const ShapeDerivative& by_load, double tolerance,
                       double angle) {
  const Eigen::VectorXd lengths = c.arm.lengths(c.q);
  const double size = c.arm.restLength();
  Case under = c;
  if (c.setting.tier == Tier::kLinear) under.setting = kExactTier;
  for (int j = 0; j < 6; ++j) {
    const auto changed = [&](double change) {
      Load with = c.load;
      PointLoad tip{c.arm.sectionCount() - 1};
      tip.offset = c.arm.link(tip.section).translation;
      (j < 3 ? tip.force : tip.moment)[j % 3] = change;
      with.points.push_back(tip);
      return under.at(c.arm, with, lengths);
    };
    // A force along the arm must be as small as one that bends it, or it would buckle.
    const std::vector<int> alike = j < 3 ? std::vector<int>{0, 1, 2} : std::vector<int>{3, 4, 5};
    double step = stepOf(by_load, j, size, angle);
    for (const int other : alike) step = std::min(step, stepOf(by_load, other, size, angle));
    expectColumn(by_load, j, alike, columnFrom(kCentral, changed, step), tolerance, step,
                 c.name + ": load");
  }
}

void expectDerivatives(const Case& c, double tolerance = kAgreement) {
  // The lowest order extrapolates its steps, which is far from linear in the load.
  const double loaded = c.setting.order == kLeastOrder ? kLeastAngle : kAngle;
  const double angle = c.setting.tier == Tier::kExact ? kExactAngle : loaded;
  const ArmModel model(c.arm, std::nullopt, c.load, c.setting);
  const ShapeJacobian found = jacobianAt(model, c.q);
  ASSERT_EQ(found.status, SolveStatus::kConverged) << c.name;
  const Eigen::VectorXd lengths = c.arm.lengths(c.q);
  const double size = c.arm.restLength();
  const int n = c.arm.actuatorCount();
  std::vector<int> all;
  for (int i = 0; i < n; ++i) all.push_back(i);
  for (int i = 0; i < n; ++i) {
    const auto changed = [&](double change) {
      Eigen::VectorXd there = lengths;
      there[i] += change;
      return c.at(c.arm, c.load, there);
    };
    const double step = stepOf(found.by_lengths, i, size, angle);
    expectColumn(found.by_lengths, i, all, columnFrom(kCentral, changed, step), tolerance, step,
                 c.name + ": length");
    const double slope = c.arm.actuator(i).contraction.slope(c.q[i]);
    EXPECT_LT((found.by_inputs.tip.col(i) - slope * found.by_lengths.tip.col(i)).norm(), 1e-15);
    EXPECT_LT((found.by_inputs.twists.col(i) - slope * found.by_lengths.twists.col(i)).norm(),
              1e-15);
  }
  for (int component = 0; component < 3; ++component) {
    std::vector<int> alike;
    for (int i = 0; i < n; ++i) alike.push_back(3 * i + component);
    for (int i = 0; i < n; ++i) {
      model::Stiffness own = c.arm.actuator(i).stiffness;
      const double value = entry(own, component);
      const auto changed = [&](double change) {
        model::Stiffness there = c.arm.actuator(i).stiffness;
        entry(there, component) += change;
        return c.at(c.arm.withStiffness(i, there), c.load, lengths);
      };
      double step = stepOf(*found.by_stiffness, alike[i], size, angle);
      if (value > 0) step = std::min(step, kEntryStep * value);
      if (value == 0) step = std::min(0.1 * step, kEntryStep * own.kappa);
      expectColumn(*found.by_stiffness, alike[i], alike,
                   columnFrom(value > 0 ? kCentral : kForward, changed, step), tolerance, step,
                   c.name + ": stiffness");
    }
  }
  if (c.setting.tier == Tier::kLinear && !c.arm.isLinear()) return;
  ASSERT_TRUE(found.by_load);
  expectLoadColumns(c, *found.by_load, tolerance, angle);
}

// Rings whose muscles all differ.
model::Arm variedArm(int sections, int count, bool resists_torsion, Random& random,
                     const model::BendingTable& bending = {}) {
  std::vector<model::Section> parts;
  for (int k = 0; k < sections; ++k) {
    test::Ring ring = test::helicalRing(count);
    ring.tilt = random.uniform(-0.3, 0.3);
    model::Section section = test::ringSection(ring, test::fig3Muscle());
    for (model::Actuator& actuator : section.actuators) {
      actuator.stiffness = {random.uniform(5, 50),
                            resists_torsion ? random.uniform(1e-5, 1e-4) : 0.0,
                            random.uniform(5e-5, 2e-4)};
    }
    section.plate = random.uniform(0, 0.02);
    section.bending = bending;
    parts.push_back(section);
  }
  return model::Arm(parts, test::tool());
}

Eigen::VectorXd innerInput(const model::Arm& arm, Random& random) {
  return (0.9 * test::randomInput(arm, random).array() + 1e4).matrix();
}

using namespace test;

TEST(Jacobian, WithoutLoadIsTheDerivativeByLengthsInputsStiffnessAndLoad) {
  Random random(1);
  for (const int sections : {1, 2, 3}) {
    for (const bool resists_torsion : {true, false}) {
      const model::Arm arm = variedArm(sections, 3 + sections % 2, resists_torsion, random);
      const Eigen::VectorXd q = innerInput(arm, random);
      // Without weight, so that the exact tier has the response to a load of an arm without one.
      Load load = weightless(sections, 900);
      load.K_eps.back() = 1100;
      expectDerivatives({std::to_string(sections) + " sections", arm, load, kLinearTier, q});
      // A potential: displacements of the tip by forces there are symmetric.
      const ShapeJacobian found =
          jacobianAt(ArmModel(arm, std::nullopt, load, kLinearTier), q, {false, true});
      EXPECT_LT((found.by_load->tip - found.by_load->tip.transpose()).norm(),
                1e-12 * found.by_load->tip.norm());
    }
  }
  const model::Arm tapered = taperedArm(0.26);
  expectDerivatives(
      {"taper", tapered, weightless(1, 1100), kLinearTier, innerInput(tapered, random)});
  EXPECT_FALSE(jacobianAt(ArmModel(tapered), tapered.inputAt(0.4)).by_load);
}

const StiffnessTable kStiffening{{0, 1.5e5, kMaxPressure}, {1, 1.5, 4}};

class JacobianByPressure : public ::testing::TestWithParam<model::BendingTable::Argument> {};
INSTANTIATE_TEST_SUITE_P(, JacobianByPressure,
                         ::testing::Values(model::BendingTable::Argument::kMean,
                                           model::BendingTable::Argument::kOthers));

TEST_P(JacobianByPressure, FollowsAKKappaThatDependsOnIt) {
  Random random(17);
  const model::Arm arm = variedArm(2, 3, true, random, {kStiffening, GetParam()});
  const Eigen::VectorXd q = innerInput(arm, random);
  Load load = loadOfLinks(arm, {5, 0, -8}, {0.05, 0.1, -0.08});
  for (const TierSetting& setting : {kLinearTier, loadedTier(3), loadedTier(5), kExactTier}) {
    expectDerivatives({"K_kappa, " + setting.name(), arm, load, setting, q}, 3 * kAgreement);
  }
  load.tables = {kTable, {}};
  expectDerivatives({"K_kappa and K_eps", arm, load, loadedTier(5), q}, 3 * kAgreement);
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
      Eigen::MatrixXd turned = tip.by;
      for (const int half : {0, 3}) {
        turned.middleRows<3>(half) = tip.tip.rotation * tip.by.middleRows<3>(half);
      }
      EXPECT_LT((turned - whole.by_lengths.tip).norm(), tolerance * turned.norm())
          << setting.name();
    }
  }
}

}  // namespace
}  // namespace helix_arm::statics
