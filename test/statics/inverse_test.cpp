#include "helix_arm/statics/inverse.hpp"

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "helix_arm/model/batch.hpp"
#include "statics/arms_under_load.hpp"
#include "statics/inverse/box_quadratic.hpp"
#include "support/allocation_counter.hpp"
#include "support/paper_arm.hpp"
#include "support/random.hpp"
#include "support/test_size.hpp"

namespace helix_arm::statics {
namespace {

double preferenceCost(const model::Arm& arm, const Eigen::VectorXd& q,
                      const Eigen::VectorXd& reference) {
  double cost = 0;
  for (int i = 0; i < q.size(); ++i) {
    const model::Range& limits = arm.actuator(i).limits;
    cost += std::pow((q[i] - reference[i]) / (limits.upper - limits.lower), 2);
  }
  return cost;
}

TEST(Preference, FindsTheBestAlongTheOneSpareMotionOfFourMuscles) {
  // Lengths (+, -, +, -) move nothing of four straight muscles: a line search along it is the
  // reference.
  const model::Arm arm = test::ringArm(test::straightRing(4));
  const model::Contraction muscle = test::fig3Muscle();
  const Eigen::Vector4d q(3e5, 1.2e5, 1e5, 1.5e5), spare(1, -1, 1, -1);
  const Eigen::VectorXd l = arm.lengths(q);
  for (const Preference preference : {Preference::kMinPressure, Preference::kCocontraction}) {
    const Eigen::VectorXd reference = arm.inputAt(preference == Preference::kMinPressure ? 0 : 0.6);
    double least = std::numeric_limits<double>::infinity();
    for (int k = -20000; k <= 20000; ++k) {
      const Eigen::VectorXd moved = l + 5e-6 * k * spare;
      if ((moved.array() < muscle.lengthRange().lower).any() ||
          (moved.array() > muscle.lengthRange().upper).any()) {
        continue;
      }
      Eigen::VectorXd input(4);
      for (int i = 0; i < 4; ++i) input[i] = muscle.inverse(moved[i]);
      least = std::min(least, preferenceCost(arm, input, reference));
    }
    ASSERT_LT(least, 0.99 * preferenceCost(arm, q, reference)) << "q is already the best";
    InverseOptions options;
    options.preference = preference;
    options.cocontraction = 0.6;
    InverseSolver solver(arm, options);
    const InverseResult position = solver.toPosition(arm.tip(q).translation, q);
    const InverseResult pose = solver.toPose(arm.tip(q), q);
    const InverseResult twists = solver.toTwists(arm.twists(q), q);
    for (const InverseResult& result : {position, pose, twists}) {
      EXPECT_EQ(result.status, InverseStatus::kReached);
      EXPECT_NEAR(preferenceCost(arm, result.input, reference), least, 1e-5);
    }
  }
}

// Tips [m] of a section of three of the paper's muscles, at a grid of pressures from 0 to
// kMaxPressure: so many along each axis, the first actuator's pressure changing fastest.
struct TipGrid {
  std::vector<double> x, y, z;  // base frame

  TipGrid(const model::Arm& arm, int per_axis) {
    std::vector<double> q[3];
    for (int i = 0; i < per_axis * per_axis * per_axis; ++i) {
      int rest = i;
      for (auto& axis : q) {
        axis.push_back(test::kMaxPressure * (rest % per_axis) / (per_axis - 1));
        rest /= per_axis;
      }
    }
    const double* inputs[] = {q[0].data(), q[1].data(), q[2].data()};
    x.resize(q[0].size()), y.resize(x.size()), z.resize(x.size());
    model::TipBatch(arm).columns(inputs, x.size(), x.data(), y.data(), z.data());
  }

  std::size_t count() const { return x.size(); }
  Eigen::Vector3d tip(std::size_t j) const { return {x[j], y[j], z[j]}; }
};

TEST(Inverse, GivesTheClosestTipWhereTheTargetCannotBeReached) {
  // Against the closest of 2 million tips sampled within the limits.
  const int targets = test::draws(12, 60);
  for (const auto& ring : {test::straightRing(), test::helicalRing()}) {
    const model::Arm arm = test::ringArm(ring);
    const TipGrid tips(arm, 126);

    InverseSolver solver(arm);
    test::Random random(103);
    int unreachable = 0;
    for (int i = 0; i < targets; ++i) {
      const Eigen::Vector3d target =
          Eigen::Vector3d(0.25, 0, 0) + random.uniform(0.1, 0.6) * random.direction<3>();
      double sampled = std::numeric_limits<double>::infinity();
      for (std::size_t j = 0; j < tips.count(); ++j) {
        sampled = std::min(sampled, (tips.tip(j) - target).squaredNorm());
      }
      sampled = std::sqrt(sampled);
      const InverseResult result = solver.toPosition(target, arm.inputAt(0.5));
      EXPECT_TRUE(result.converged()) << target.transpose();
      EXPECT_LE(result.residual, sampled + 1e-9) << target.transpose();
      EXPECT_GE(result.residual, sampled - 0.01) << "closer than the arm can come";
      EXPECT_NEAR((arm.tip(result.input).translation - target).norm(), result.residual, 1e-12);
      if (result.status != InverseStatus::kUnreachable) continue;
      ++unreachable;
      EXPECT_TRUE(std::any_of(result.limits.begin(), result.limits.end(),
                              [](Limit l) { return l != Limit::kNone; }));
    }
    EXPECT_GT(unreachable, targets * 5 / 6);
  }
}

TEST(Inverse, DoesNotAllocate) {
  for (const auto& [count, sections] : {std::pair(3, 1), {5, 2}}) {
    const model::Arm arm = test::ringArm(test::helicalRing(count), sections);
    InverseSolver solver(arm);
    const Eigen::VectorXd start = arm.inputAt(0.5);
    const Eigen::VectorXd q = Eigen::VectorXd::Constant(sections * count, 1e5);
    const model::Twists g = arm.twists(q);
    const lie::SE3 tip = arm.tip(q);
    const Eigen::Vector3d far(5, 5, 5);
    const test::AllocationCounter counter;
    solver.toPosition(tip.translation, start);
    solver.toPosition(far, start);
    solver.toPose(tip, start);
    solver.toTwists(g, start);
    EXPECT_EQ(counter.count(), 0u);
  }
}

// Targets that can be reached are reached, all of them.

void expectWithinLimits(const model::Arm& arm, const Eigen::VectorXd& q) {
  for (int i = 0; i < q.size(); ++i) ASSERT_TRUE(arm.actuator(i).limits.contains(q[i])) << q[i];
}

// Failures among `count` tips of random inputs, each from the middle of the limits.
int failuresToPosition(const model::Arm& arm, int count, unsigned seed,
                       const InverseOptions& options = {}) {
  InverseSolver solver(arm, options);
  const Eigen::VectorXd start = arm.inputAt(0.5);
  test::Random random(seed);
  int failures = 0;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d target = arm.tip(test::randomInput(arm, random)).translation;
    const InverseResult& result = solver.toPosition(target, start);
    expectWithinLimits(arm, result.input);
    const double error = (arm.tip(result.input).translation - target).norm();
    EXPECT_NEAR(error, result.position_error, 1e-12);
    if (!(error <= options.position_tolerance) || result.status != InverseStatus::kReached)
      ++failures;
  }
  return failures;
}

TEST(Inverse, ReachesRandomTips) {
  const int count = test::draws(20000, 500000);
  EXPECT_EQ(failuresToPosition(test::ringArm(test::straightRing()), count, 91), 0);
  EXPECT_EQ(failuresToPosition(test::ringArm(test::helicalRing()), count, 92), 0);
}

// Thin soft arms bend to more than a circle: the tip comes back to the base, where turning the
// circle hardly moves it, and a start in another direction has no way on.
TEST(Inverse, ReachesTipsOfArmsThatCurlToTheirOwnBase) {
  struct Curl {
    test::Ring ring;
    int sections, count;
  };
  const test::Ring soft{3, 0.006, 0.0, {10.0, 0.0, 1e-6}}, thin{3, 0.0075, 0.0, {10.0, 0.0, 5e-6}};
  test::Ring four = thin, six = thin;
  four.count = 4;
  six.count = 6;
  test::Random random(99);
  const int many = test::draws(500, 3000), some = test::draws(100, 500);
  for (const Curl& curl :
       {Curl{soft, 1, many}, {thin, 1, many}, {four, 1, many}, {six, 1, some}, {thin, 2, some}}) {
    const model::Arm arm = test::ringArm(curl.ring, curl.sections);
    EXPECT_EQ(failuresToPosition(arm, curl.count, 99), 0);
    // Again with the last section within 0.2 rad of a whole turn.
    InverseSolver solver(arm);
    int failures = 0, compared = 0;
    while (compared < curl.count) {
      const Eigen::VectorXd q = test::randomInput(arm, random);
      const double turn = arm.twists(q).col(curl.sections - 1).tail<3>().norm();
      if (std::abs(turn - 2 * test::kPi) > 0.2) continue;
      ++compared;
      const Eigen::Vector3d target = arm.tip(q).translation;
      const InverseResult& result = solver.toPosition(target, arm.inputAt(0.5));
      const bool reached = result.status == InverseStatus::kReached &&
                           (arm.tip(result.input).translation - target).norm() <= 1e-6;
      if (!reached) ++failures;
    }
    EXPECT_EQ(failures, 0) << curl.ring.count << " actuators, " << curl.sections << " sections";
  }
}

TEST(Inverse, ReachesPosesAndTwists) {
  for (const int sections : {1, 2}) {
    for (const auto& ring : {test::straightRing(), test::helicalRing(), test::helicalRing(4)}) {
      const model::Arm arm = test::ringArm(ring, sections);
      InverseSolver solver(arm);
      test::Random random(98);
      int pose_failures = 0;
      for (int i = 0; i < test::draws(300, 3000); ++i) {
        const Eigen::VectorXd q = test::randomInput(arm, random);
        const lie::SE3 tip = arm.tip(q);
        const InverseResult& pose = solver.toPose(tip, arm.inputAt(0.5));
        const lie::SE3 reached = arm.tip(pose.input);
        if (pose.status != InverseStatus::kReached ||
            (reached.translation - tip.translation).norm() > 1e-6 ||
            (reached.rotation - tip.rotation).norm() > 3e-5) {
          ++pose_failures;
        }
        const model::Twists g = arm.twists(q);
        const InverseResult& twists = solver.toTwists(g, arm.inputAt(0.5));
        EXPECT_EQ(twists.status, InverseStatus::kReached);
        EXPECT_LT((arm.twists(twists.input) - g).norm(), 2e-5);
      }
      EXPECT_EQ(pose_failures, 0) << sections << " sections of " << ring.count;
    }
  }
}

ArmModel modelOf(const model::Arm& arm, const Load& load, Tier tier,
                 std::optional<int> order = {}) {
  return ArmModel(arm, std::nullopt, load, request(tier, order));
}

TEST(LoadedInverse, FindsInputsOfReachableTips) {
  const model::Arm arms[] = {test::softHelicalArm(), test::ringArm(test::straightRing(4)),
                             test::ringArm(test::straightRing(), 2)};
  test::Random random(31);
  for (const model::Arm& arm : arms) {
    const Load load = test::evenLoad(arm.sectionCount(), {0, 0, -test::kGravity}, 0.1, 1200);
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

// ---- Quadratic steps in a box -------------------------------------------------------------------

TEST(BoxQuadratic, MeetsTheOptimalityConditions) {
  test::Random random(81);
  int at_bounds = 0, free = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    const int n = random.integer(1, 12);
    BoxQuadratic problem(n);
    Eigen::MatrixXd J(random.integer(1, 8), n);
    for (int i = 0; i < J.size(); ++i) J(i) = random.uniform(-1, 1);
    problem.H = J.transpose() * J + 1e-3 * Eigen::MatrixXd::Identity(n, n);
    for (int i = 0; i < n; ++i) {
      problem.g[i] = random.uniform(-1, 1);
      problem.lower[i] = random.uniform(0, 1) < 0.2 ? 0 : -random.logUniform(1e-3, 10);
      problem.upper[i] = random.uniform(0, 1) < 0.2 ? 0 : random.logUniform(1e-3, 10);
    }
    const Eigen::VectorXd x = problem.solve();
    const Eigen::VectorXd gradient = problem.H * x + problem.g;
    for (int i = 0; i < n; ++i) {
      EXPECT_GE(x[i], problem.lower[i]);
      EXPECT_LE(x[i], problem.upper[i]);
      const bool at_lower = x[i] <= problem.lower[i], at_upper = x[i] >= problem.upper[i];
      at_lower || at_upper ? ++at_bounds : ++free;
      // Zero inside, pushing outwards at a bound.
      EXPECT_TRUE(at_lower || gradient[i] < 1e-8) << "n " << n << " trial " << trial;
      EXPECT_TRUE(at_upper || gradient[i] > -1e-8) << "n " << n << " trial " << trial;
    }
  }
  EXPECT_GT(at_bounds, 1000);
  EXPECT_GT(free, 1000);
}

}  // namespace
}  // namespace helix_arm::statics
