// K_eps that depends on pressure, under load.
#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"
#include "statics/arms_under_load.hpp"
#include "support/expect_refusal.hpp"

namespace helix_arm::statics {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

TEST(StiffnessTable, IsLinearBetweenItsInputsAndConstantBeyond) {
  EXPECT_EQ(kTable.at(-1), 45 / 14.);
  EXPECT_EQ(kTable.at(0), 45 / 14.);
  EXPECT_NEAR(kTable.at(5e4), 0.5 * (45 / 14. + 1), 1e-14);
  EXPECT_EQ(kTable.at(1e5), 1);
  EXPECT_NEAR(kTable.at(1.5e5), 0.5 * (1 + 37 / 14.), 1e-14);
  EXPECT_EQ(kTable.at(1e7), 52 / 14.);
  // That of a section whose K_eps is constant, beside one with a table.
  EXPECT_EQ(StiffnessTable().at(1e5), 1);
}

// The definition: an arm whose stiffness entries are those at the inputs.
TEST(StiffnessTable, TwistAndComplianceAreTheEquilibriumOfThatStiffness) {
  const model::Arm arm = test::softHelicalArm();
  const Load load = loadWith(kTable);
  test::Random random(101);
  for (int i = 0; i < 20; ++i) {
    const Eigen::VectorXd q = test::randomInput(arm, random);
    const model::Unloaded found = unloadedUnder(arm, load, q);
    std::vector<model::Strand<lie::SE3>> strands;
    for (int j = 0; j < 3; ++j) {
      strands.push_back(
          {arm.actuator(j).X_O, kTable.at(q[j]) * arm.actuator(j).stiffness.diagonal<lie::SE3>()});
    }
    const auto expected = model::solveEquilibrium(strands);
    EXPECT_LT((found.twists.col(0) - expected.map * arm.lengths(q)).norm(), 1e-10);
    const lie::Matrix6 C = arm.freeLength(0) / load.K_eps[0] * expected.compliance;
    EXPECT_LT((found.compliance - C).norm(), 1e-10 * C.norm());
    const model::Unloaded same = unloadedUnderOfLengths(arm, load, arm.lengths(q));
    EXPECT_LT((same.twists - found.twists).norm(), 1e-9);
  }
}

// Compliance of the tip by its definition: small forces along and against each axis.
class Compliance {
 public:
  explicit Compliance(const ArmModel& model) {
    for (int axis = 0; axis < 3; ++axis) {
      for (const double sign : {-1.0, 1.0}) {
        Load load = *model.load();
        load.points.push_back({});
        load.points.back().force = sign * kForce * Eigen::Vector3d::Unit(axis);
        pushed_.emplace_back(model.arm(), std::nullopt, load, TierSetting{Tier::kLoaded, 4});
      }
    }
  }

  double at(const Eigen::VectorXd& input) const {
    double sum = 0.0;
    for (int axis = 0; axis < 3; ++axis) {
      const Tip below = pushed_[2 * axis].tip(input), above = pushed_[2 * axis + 1].tip(input);
      if (!below.converged() || !above.converged()) return kInfinity;
      sum += (above.tip.translation - below.tip.translation)[axis] / (2 * kForce);
    }
    return sum;
  }

 private:
  static constexpr double kForce = 0.01;  // [N]
  std::vector<ArmModel> pushed_;
};

// Least compliance of inputs that reach a target, by brute force: the closest solutions to random
// inputs, then to inputs at shrinking random distances from the best one.
double leastCompliance(const ArmModel& model, const Compliance& compliance,
                       const Eigen::Vector3d& target, test::Random& random) {
  InverseOptions options;
  options.preference = Preference::kMinChange;
  InverseSolver solver(model, options);
  const model::Arm& arm = model.arm();
  double least = kInfinity;
  Eigen::VectorXd best;
  const auto consider = [&](const Eigen::VectorXd& start) {
    const InverseResult& result = solver.toPosition(target, start);
    if (result.status != InverseStatus::kReached) return;
    const double found = compliance.at(result.input);
    if (!(found < least)) return;
    least = found;
    best = result.input;
  };
  for (int i = 0; i < 80; ++i) consider(test::randomInput(arm, random));
  for (int i = 0; i < 80 && best.size() > 0; ++i) {
    const double radius = 0.3 * std::pow(0.01, i / 80.0) * test::kMaxPressure;
    Eigen::VectorXd start = best;
    for (double& one : start) one += radius * random.normal();
    consider(arm.clamped(start));
  }
  return least;
}

// Muscles that are softest inside their range give the compliance several minima.
TEST(PreferStiff, IsNoMoreCompliantThanTheBestOfBruteForce) {
  const StiffnessTable rising{{0, test::kMaxPressure}, {1, 4}};
  test::Random random(105);
  int compared = 0, worse = 0;
  for (const int count : {4, 6}) {
    for (const StiffnessTable& table : {kTable, rising}) {
      const ArmModel model(test::ringArm(test::straightRing(count)), std::nullopt,
                           loadWith(table, 300, 0.05), TierSetting{Tier::kLoaded, 4});
      const Compliance compliance(model);
      InverseOptions stiff;
      stiff.preference = Preference::kStiff;
      InverseSolver solver(model, stiff);
      for (int i = 0; i < 7; ++i) {
        const Tip target = model.tip(test::randomInput(model.arm(), random));
        if (!target.converged()) continue;
        const Eigen::Vector3d& place = target.tip.translation;
        const InverseResult& result =
            solver.toPosition(place, test::randomInput(model.arm(), random));
        ASSERT_EQ(result.status, InverseStatus::kReached);
        EXPECT_LT((model.tip(result.input).tip.translation - place).norm(), 2e-6);
        const double ours = compliance.at(result.input);
        const double least = leastCompliance(model, compliance, place, random);
        ++compared;
        worse += ours > 1.005 * least ? 1 : 0;
        EXPECT_LE(ours, 1.005 * least) << count << " muscles, target " << place.transpose();
      }
    }
  }
  EXPECT_GE(compared, 24) << "targets balanced";
  EXPECT_EQ(worse, 0) << "of " << compared;
}

TEST(PreferStiff, NeedsAKnownStiffness) {
  InverseOptions stiff;
  stiff.preference = Preference::kStiff;
  const model::Arm arm = test::ringArm(test::straightRing(4));
  const ArmModel unknown(arm);
  test::expectRefusal("K_eps_n", [&] { InverseSolver(unknown, stiff); });
  EXPECT_THROW(InverseSolver(arm, stiff), std::invalid_argument);
}

}  // namespace
}  // namespace helix_arm::statics
