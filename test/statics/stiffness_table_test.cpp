// K_eps that depends on pressure, under load; K_kappa that depends on the mean pressure.
#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/model/batch.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"
#include "statics/arms_under_load.hpp"
#include "support/has.hpp"
#include "support/refusal.hpp"
#include "support/tapered_arm.hpp"
#include "support/test_size.hpp"

namespace helix_arm::statics {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// The definition: an arm whose stiffness entries are those at the inputs.
TEST(StiffnessTable, TwistAndComplianceAreTheEquilibriumOfThatStiffness) {
  const model::Arm arm = test::softHelicalArm();
  const Load load = loadWith(kTable);
  test::Random random(101);
  for (int i = 0; i < 20; ++i) {
    const Eigen::VectorXd q = test::randomInput(arm, random);
    const model::Unloaded found = unloadedUnder(arm, load, q);
    std::vector<model::ActuatorElement<lie::SE3>> elements;
    for (int j = 0; j < 3; ++j) {
      elements.push_back(
          {arm.actuator(j).X_O, kTable.at(q[j]) * arm.actuator(j).stiffness.diagonal<lie::SE3>()});
    }
    const auto expected = model::solveEquilibrium(elements);
    EXPECT_LT((found.twists.col(0) - expected.map * arm.lengths(q)).norm(), 1e-10);
    const lie::Matrix6 C = arm.freeLength(0) / load.K_eps[0] * expected.compliance;
    EXPECT_LT((found.compliance - C).norm(), 1e-10 * C.norm());
    const model::Unloaded same = unloadedUnderOfLengths(arm, load, arm.lengths(q));
    EXPECT_LT((same.twists - found.twists).norm(), 1e-9);
  }
}

// Chambers in one body, which lengthen in proportion to the pressure.
const model::Contraction kChamber = model::Contraction::table({0, 1.2e5}, {0.14, 0.19});
constexpr double kRadius = 0.02, kKappa = kRadius * kRadius / 4;

model::Arm chambers(const model::BendingTable& bending, double tilt) {
  model::Section section = test::ringSection({3, kRadius, tilt, {10, 1e-4, kKappa}}, kChamber);
  section.bending = bending;
  return model::Arm({section});
}
// Doubles what resists bending, K_kappa + r^2 / 2, from a mean of 20 to one of 35 kPa.
const StiffnessTable kDoubling{{0, 20e3, 35e3, 1.2e5}, {1, 1, 4, 5}};

// Elastic energy (eq. 14), which is quadratic in the twist.
double energy(const model::Arm& arm, const lie::Vector6& g, const Eigen::VectorXd& q,
              double bending) {
  double sum = 0;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    model::Stiffness K = arm.actuator(i).stiffness;
    K.kappa *= bending;
    const lie::Vector6 strain =
        arm.actuator(i).X_O.inverse().adjoint() * g - arm.lengths(q)[i] * lie::Vector6::Unit(0);
    sum += strain.cwiseAbs2().dot(K.diagonal<lie::SE3>()) / 2;
  }
  return sum;
}

TEST(BendingTable, TwistsHaveTheLeastEnergyAndHalveWhenTheOtherChambersDouble) {
  const model::Arm arm = chambers(kDoubling, 0.1), straight = chambers(kDoubling, 0);
  const Eigen::Vector3d one(30e3, 15e3, 15e3), other(45e3, 30e3, 30e3);
  for (const auto& [q, bending] : {std::pair{one, 1.0}, {other, 4.0}}) {
    const lie::Vector6 g = arm.twists(q);
    for (int i = 0; i < 6; ++i) {
      const double above = energy(arm, g + lie::Vector6::Unit(i), q, bending),
                   below = energy(arm, g - lie::Vector6::Unit(i), q, bending);
      EXPECT_LT(std::abs(above - below), 1e-9 * (above + below - 2 * energy(arm, g, q, bending)));
    }
    EXPECT_LT((arm.twistsOfLengths(arm.lengths(q)) - g).norm(), 1e-12);
    EXPECT_EQ(arm.tip(q).translation, arm.tipOf(arm.twists(q)).translation);
    Eigen::Vector3d tip;
    model::TipBatch(arm).rows({q.data(), 24, 8}, 1, tip.data());
    EXPECT_EQ(tip, arm.tip(q).translation);
  }
  EXPECT_NEAR(2 * model::curvatureOf(straight.twists(other)),
              model::curvatureOf(straight.twists(one)), 1e-12);
}

TEST(BendingTable, ATaperedSectionIsRefusedWithEitherTable) {
  model::Section tapered = test::taperedSection(test::straightRing(), {0.05, 0.025}, {0, 0});
  const model::Arm plain({tapered});
  const char* const words = "depends on pressure, which needs a section without taper";
  EXPECT_TRUE(test::has(test::refusal([&] { ArmModel(plain, {}, loadWith(kTable)); }), words));
  tapered.bending = kDoubling;
  EXPECT_TRUE(test::has(test::refusal([&] { model::Arm({tapered}); }), words));
}

TEST(BendingTable, ThePressureOfTheOthersIs0OfOneChamberAloneAndThatOfAllAlike) {
  using Argument = model::BendingTable::Argument;
  const model::BendingTable table(kDoubling, Argument::kOthers);
  EXPECT_EQ(table.argumentAt(Eigen::Vector3d(1e5, 0, 0)), 0);
  EXPECT_DOUBLE_EQ(table.argumentAt(Eigen::Vector4d::Constant(3e4)), 3e4);
  EXPECT_DOUBLE_EQ(table.argumentAt(Eigen::Vector3d(4e4, 4e4, 0)), 2e4);
  EXPECT_DOUBLE_EQ(table.argumentAt(Eigen::Vector3d(-4e4, -4e4, 0)), -2e4) << "vacuum";
  EXPECT_EQ(table.argumentAt(Eigen::Vector3d::Zero()), 0);
  // One chamber at 120 kPa bends as far as without the table, and half as far in the end.
  const model::Arm arm = chambers({kDoubling, Argument::kOthers}, 0), plain = chambers({}, 0);
  const Eigen::Vector3d alone(1.2e5, 0, 0);
  EXPECT_LT((arm.twists(alone) - plain.twists(alone)).norm(), 1e-12);
  const Eigen::Vector3d crowded(1.0e5, 35e3, 35e3);
  EXPECT_LT(model::curvatureOf(arm.twists(crowded)),
            0.5 * model::curvatureOf(plain.twists(crowded)));
  EXPECT_LT((arm.twistsOfLengths(arm.lengths(crowded)) - arm.twists(crowded)).norm(), 1e-12);
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
      for (int i = 0; i < test::draws(2, 7); ++i) {
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
  EXPECT_GE(compared, test::draws(6, 24)) << "targets balanced";
  EXPECT_EQ(worse, 0) << "of " << compared;
}

}  // namespace
}  // namespace helix_arm::statics
