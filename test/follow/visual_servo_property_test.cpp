// What holds of a visual servo whatever it is given.
#include <Eigen/Cholesky>
#include <cstdio>
#include <limits>

#include <gtest/gtest.h>

#include "helix_arm/follow/visual_servo.hpp"
#include "support/loop_bench.hpp"
#include "support/paper_arm.hpp"

namespace helix_arm::follow {
namespace {

using statics::ArmModel;
using statics::Correction;
using test::LoopBench;

ArmModel helicalModel() { return ArmModel(test::ringArm(test::helicalRing())); }

bool isPositiveDefinite(const Eigen::MatrixXd& matrix) {
  return Eigen::LLT<Eigen::MatrixXd>(matrix).info() == Eigen::Success;
}

// Turns of gaps, outliers, NaN, repeated and old stamps, limits, vents and changes of mind.
TEST(VisualServo, StaysConsistentThroughRandomTurns) {
  constexpr int kTurns = 100'000;
  const ArmModel model = helicalModel();
  const model::Arm& arm = model.arm();
  Correction truth(arm);
  truth.stiffness_factors = {0.7, 1.0, 1.3};
  LoopBench bench(model, truth, LoopBench::config(), {});
  test::Random random(7);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Eigen::VectorXd prior = bench.loop.tracker().parameterPrior();
  const int m = bench.loop.tracker().parameterCount();
  bool sees = true;
  double farthest = 0;
  for (int k = 0; k < kTurns; ++k) {
    switch (random.integer(0, 299)) {
      case 0:
        bench.loop.aimAt(arm.tip(test::randomInput(arm, random)).translation);
        break;
      case 1:
        bench.loop.aimAt(Eigen::Vector3d(0.6 * random.direction<3>()));
        break;
      case 2:
        bench.loop.release();
        break;
      case 3:
        bench.loop.enable(random.integer(0, 3) > 0);
        break;
      case 4:
        sees = random.integer(0, 2) > 0;
        break;
      case 5:
        bench.loop.close(random.integer(0, 2) > 0);
        break;
      case 6:
        bench.loop.setOnContact(static_cast<OnContact>(random.integer(0, 2)));
        bench.options.push.setZero();
        if (random.integer(0, 2) == 0) bench.options.push.tail<3>() = 0.05 * random.direction<3>();
        break;
      case 7:
        if (random.integer(0, 4) == 0) bench.loop.reset();
        break;
      case 8:
        bench.loop.follow(
            control::TipPath({{0.0, arm.tip(test::randomInput(arm, random)).translation, {}, {}},
                              {random.uniform(0.5, 3),
                               arm.tip(test::randomInput(arm, random)).translation,
                               {},
                               {}}}));
        break;
      default:
        break;
    }
    bench.step(sees);
    if (random.integer(0, 9) == 0) {  // a picture that lies, in between
      model::Twists twists = bench.trueTwists();
      double stamp = bench.time() - random.uniform(-0.1, 0.3);
      switch (random.integer(0, 3)) {
        case 0:
          twists.topRows<3>().array() += 0.05 * random.normal();
          break;
        case 1:
          twists *= -1;
          break;
        case 2:
          twists(random.integer(0, 5), 0) = nan;
          break;
        default:
          stamp -= 2;
          break;
      }
      bench.loop.picture(stamp, bench.time(), twists, bench.covariance());
    }
    const Turn& turn = bench.loop.turn();
    ASSERT_TRUE(turn.pressure.allFinite()) << k;
    for (int i = 0; i < arm.actuatorCount(); ++i) {
      ASSERT_TRUE(arm.actuator(i).limits.contains(turn.pressure[i])) << k;
    }
    for (const estimation::ArmFilter* filter : {&bench.loop.tracker(), &bench.loop.watch()}) {
      const estimation::Gaussian& state = filter->state();
      ASSERT_TRUE(state.mean.allFinite()) << k;
      farthest = std::max(farthest, state.mean.head(m).cwiseQuotient(prior).cwiseAbs().maxCoeff());
      ASSERT_TRUE(k % 100 != 0 || isPositiveDefinite(state.covariance)) << k;
    }
  }
  std::printf("[  FIGURE  ] theta was at most %.1f of its deviations away\n", farthest);
  EXPECT_LT(farthest, 5);
}

// Along each direction of the arm the loop is stable if the true motion is between none and twice
// the model's, whatever latency, lag and smoothing are; and its bound lies far beyond.
TEST(VisualServo, IsStableWithinTheSmallGain) {
  const ArmModel model = helicalModel();
  const Eigen::VectorXd middle = model.arm().inputAt(Eigen::Vector3d(0.2, 0.3, 0.25));
  const Eigen::Vector3d target = model.tip(middle).tip.translation;
  test::Random random(8);
  for (int run = 0; run < 40; ++run) {
    VisualServoConfig config = LoopBench::config();
    // The proof is for the bias alone.
    config.filter.stiffness_deviation = {1e-6, 1e-6, 1e-6};
    config.filter.length_deviation = 1e-8;
    config.smoothing = random.uniform(0.1, 0.5);
    LoopBench::Options options;
    options.gain = random.uniform(0.5, 1.5);
    options.latency = random.uniform(0.03, 0.3);
    options.time_constant = random.uniform(0.05, 0.3);
    options.reading_noise = 100;
    options.seed = 10 + static_cast<unsigned>(run);
    config.time_constant = options.time_constant;
    LoopBench bench(model, Correction(model.arm()), config, options);
    bench.loop.aimAt(target);
    bench.run(25);
    EXPECT_EQ(bench.loop.state(), LoopState::kClosed);
    EXPECT_LT(bench.error(), 2e-3)
        << "gain " << options.gain << ", latency " << options.latency << " s, lag "
        << options.time_constant << " s, smoothing " << config.smoothing << " s";
  }
}

}  // namespace
}  // namespace helix_arm::follow
