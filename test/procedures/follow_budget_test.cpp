#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include <gtest/gtest.h>

#include "procedures/follow_run.hpp"
#include "support/random.hpp"
#include "support/shipped_scene.hpp"
#include "support/test_size.hpp"

namespace helix_arm::procedures {
namespace {

using estimation::BudgetPart;
using estimation::TipErrorBudget;
using test::Random;

// The demo rig with another true arm (a common length scale of 1.2 % is what 2 % for each muscle by
// itself amount to), and tags and camera that are misplaced as its priors say.
io::Scene drawScene(unsigned seed, Random& random) {
  const auto text = [](double value) { return std::to_string(value); };
  return test::demo(
      {{"simulation.arm.K_gamma_scale", text(std::exp(0.3 * random.normal()))},
       {"simulation.arm.K_kappa_scale", text(std::exp(0.3 * random.normal()))},
       {"simulation.arm.length_scale", text(std::exp(0.012 * random.normal()))},
       {"simulation.mounts.tag_translation_m", "0.0005"},
       {"simulation.mounts.tag_rotation_deg", "0.5"},
       {"simulation.mounts.camera_translation_m", "0.001"},
       {"simulation.mounts.camera_rotation_deg", "0.25"},
       {"simulation.mounts.seed", std::to_string(seed)},
       {"tags.placement_prior.translation_m", "0.0005"},
       {"tags.placement_prior.rotation_deg", "0.5"},
       {"vision.base_prior.translation_m", "0.001"},
       {"vision.base_prior.rotation_deg", "0.25"},
       // So that the noise of the first reading never keeps the arm from being enabled.
       {"safety.vented_below_kpa", "30"}});
}

FollowPlan drawPlan(const io::Scene& scene, unsigned seed, Random& random) {
  Eigen::VectorXd fraction(scene.arm.actuatorCount());
  for (double& one : fraction) one = random.uniform(0.05, 0.95);
  FollowPlan plan;
  plan.tips = {scene.model.tip(scene.arm.inputAt(fraction)).tip.translation};
  plan.seconds = 3.0;
  plan.seed = seed;
  return plan;
}

Eigen::Vector3d trueTipAt(const FollowResult& result, double time) {
  const auto nearest = std::min_element(result.rows.begin(), result.rows.end(),
                                        [time](const FollowRow& a, const FollowRow& b) {
                                          return std::abs(a.time - time) < std::abs(b.time - time);
                                        });
  EXPECT_LT(std::abs(nearest->time - time), 0.005);
  return nearest->true_tip;
}

// The prediction's covariance is right: the mean of e' P^-1 e of three degrees is 3, less where the
// filter is careful.
TEST(FollowBudget, CoversTheErrorOfThePredictedTip) {
  const int runs = test::draws(20, 100);
  double sum = 0, most = 0, square = 0, expected = 0;
  int outside = 0;
  for (unsigned seed = 1; seed <= static_cast<unsigned>(runs); ++seed) {
    Random random(seed);
    const io::Scene scene = drawScene(seed, random);
    const FollowResult result = runFollow(scene, drawPlan(scene, seed, random));
    ASSERT_TRUE(result.budget) << seed;
    const TipErrorBudget& budget = *result.budget;
    const Eigen::Vector3d error = trueTipAt(result, budget.time) - budget.tip;
    const double distance2 = error.dot(budget.predicted.covariance.llt().solve(error));
    sum += distance2;
    most = std::max(most, distance2);
    square += error.squaredNorm();
    expected += budget.predicted.covariance.trace();
    outside += budget.state == estimation::BudgetState::kOutside ? 1 : 0;
  }
  std::printf(
      "[  FIGURE  ] predicted tip of %d rigs: error^2 %.2f of 3 in the mean, %.1f at most; "
      "RMS %.2f mm, expected %.2f mm; outside %d\n",
      runs, sum / runs, most, 1e3 * std::sqrt(square / runs), 1e3 * std::sqrt(expected / runs),
      outside);
  EXPECT_GT(sum / runs, 0.5);
  EXPECT_LT(sum / runs, 3.0 + std::sqrt(100.0 / runs));
  EXPECT_LE(outside, std::min(1, test::mostOf(runs, 0.001)));  // 0.1 of 100 expected
}

TEST(FollowBudget, TakesPriorsOfPlacementsOrTheErrorsOfACalibration) {
  io::Scene scene = test::demo({{"tags.placement_prior.translation_m", "0.003"},
                                {"tags.placement_prior.rotation_deg", "2"}});
  const double degree = std::acos(-1.0) / 180;
  const auto deviations = [&scene] { return loopConfigOf(scene).placed->deviations; };
  EXPECT_NEAR(deviations().tags[7][1], 0.003, 1e-12);
  EXPECT_NEAR(deviations().tags[7][4], 2 * degree, 1e-12);
  EXPECT_TRUE(deviations().tags[0].isZero(0));
  // The base is learnt from the pictures: what is left is what placements may feign, less than the
  // priors of the base itself.
  const lie::Vector6 with_priors = deviations().base;
  EXPECT_GT(with_priors[0], 0);
  EXPECT_LT(with_priors[0], 0.002);
  EXPECT_LT(with_priors[5], 0.5 * degree);

  // As the loader takes them from a calibration.
  lie::Vector6 error;
  error << 0.0005, 0.0006, 0.0007, 0.005, 0.006, 0.007;
  scene.tags->tags[7].error = error;
  EXPECT_EQ(deviations().tags[7], error);
  EXPECT_NEAR(deviations().tags[8][0], 0.003, 1e-12);
  EXPECT_LT(deviations().base[0], with_priors[0]) << "a tag that is known better feigns less";

  scene.camera.reset();
  EXPECT_FALSE(loopConfigOf(scene).placed);
}

}  // namespace
}  // namespace helix_arm::procedures
