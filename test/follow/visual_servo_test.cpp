#include "helix_arm/follow/visual_servo.hpp"

#include <Eigen/Cholesky>
#include <limits>

#include <gtest/gtest.h>

#include "support/allocation_counter.hpp"
#include "support/loop_bench.hpp"
#include "support/paper_arm.hpp"
#include "support/test_size.hpp"

namespace helix_arm::follow {
namespace {

using estimation::ObservationFault;
using test::LoopBench;

using Loop = test::LoopTest;

TEST_F(Loop, GoesWhereTheModelAloneDoesNot) {
  close();
  EXPECT_LT(bench_.error(), 5e-4);
  bench_.loop.close(false);
  bench_.run(3);
  EXPECT_GT(bench_.error(), 5e-3);
}

TEST_F(Loop, CoastsWithoutPicturesAndOpensAfterAWhile) {
  close();
  const double begin = bench_.time();
  while (state() == LoopState::kClosed && bench_.time() < begin + 1) bench_.step(false);
  EXPECT_EQ(state(), LoopState::kCoasting);
  EXPECT_NEAR(bench_.time() - begin, 0.3 + bench_.options.latency, 0.04);
  while (state() == LoopState::kCoasting && bench_.time() < begin + 5) bench_.step(false);
  EXPECT_EQ(state(), LoopState::kOpen);
  EXPECT_NEAR(bench_.time() - begin, 3.0 + bench_.options.latency, 0.04);
  EXPECT_LT(bench_.error(), 1e-3) << "what was learnt is held";
  bench_.run(0.3);
  EXPECT_EQ(state(), LoopState::kClosed);
}

TEST_F(Loop, HoldsArmAndPathWhileSomethingTouchesTheArm) {
  bench_.loop.setOnContact(OnContact::kYield);
  close();
  bench_.run(12);  // contacts are found after ten seconds of pictures
  ASSERT_FALSE(bench_.loop.load().contact);
  bench_.loop.follow(control::TipPath({{0.0, here_, {}, {}}, {30.0, there_, {}, {}}}));
  bench_.run(2);
  touch();
  bench_.run(1);
  const auto before = bench_.loop.turn().path_time;
  const Eigen::VectorXd held = bench_.loop.turn().pressure;
  ASSERT_EQ(state(), LoopState::kYielding);
  EXPECT_TRUE(bench_.loop.load().contact);
  ASSERT_TRUE(before);
  bench_.run(2);
  EXPECT_EQ(bench_.loop.turn().path_time, before);
  EXPECT_LE((bench_.loop.turn().pressure - held).norm(), 1.0);
  bench_.loop.aimAt(here_);
  letGo();
  bench_.run(4);
  EXPECT_EQ(state(), LoopState::kClosed);
  EXPECT_LT(bench_.error(), 1e-3);
}

// Whatever happens at a still target, the command moves by what a correction of some millimetres
// takes, over its time constant.
TEST_F(Loop, NeverJumps) {
  close();
  Eigen::VectorXd last = bench_.loop.turn().pressure;
  double most = 0;
  const auto run = [&](double seconds, bool sees) {
    const int steps = static_cast<int>(seconds / LoopBench::kStep);
    for (int k = 0; k < steps; ++k) {
      bench_.step(sees);
      most = std::max(most, (bench_.loop.turn().pressure - last).cwiseAbs().maxCoeff());
      last = bench_.loop.turn().pressure;
    }
  };
  run(1, true);
  run(5, false);
  run(1, true);
  const double quiet = most;
  EXPECT_LT(quiet, 2e3);  // of 414 kPa
  bench_.loop.close(false);
  run(2, true);
  bench_.loop.close(true);
  run(2, true);
  bench_.loop.reset();
  run(2, true);
  EXPECT_LT(most, 8e3);  // 19 mm of correction go and come
}

// The clock is set back, as by a recording that begins again: what is known of the arm stays.
TEST_F(Loop, GoesOnWhereTheClockIsSetBack) {
  close();
  const Eigen::VectorXd theta = bench_.loop.tracker().state().mean;
  const Eigen::VectorXd reading = bench_.pressure();
  bench_.loop.reading(1.0, reading, reading);
  EXPECT_EQ(bench_.loop.tracker().state().mean, theta);
  EXPECT_NE(state(), LoopState::kIdle);
  EXPECT_EQ(bench_.loop.picture(0.5, 1.0, bench_.trueTwists(), bench_.covariance()).fault,
            ObservationFault::kTooOld);
  for (int k = 1; k <= 20; ++k) {
    const double now = 1.0 + 0.01 * k;
    bench_.loop.reading(now, reading, reading);
    EXPECT_TRUE(bench_.loop.picture(now, now, bench_.trueTwists(), bench_.covariance()).accepted());
  }
  bench_.loop.reading(1.3, reading, reading);
  EXPECT_EQ(state(), LoopState::kClosed);
}

// A told mode of a second shapes the steps of an arm that does not swing.
TEST_F(Loop, AShapedStepStaysInsideTheLimitsAndEndsWhereTheClockIsSetBack) {
  follow::VisualServoConfig config = LoopBench::config();
  config.mode = estimation::Mode{1.0, 0.1};
  LoopBench bench(model_, truthOf(model_.arm()), config, {});
  const auto step = [&] {
    bench.step();
    for (int i = 0; i < model_.arm().actuatorCount(); ++i) {
      const model::Range& limits = model_.arm().actuator(i).limits;
      ASSERT_TRUE(limits.contains(bench.loop.turn().pressure[i])) << i;
    }
  };
  const Eigen::Vector3d high = tipAt(0.95, 0.0, 0.0), low = tipAt(0.0, 0.0, 0.95);
  bench.loop.aimAt(high);
  for (int k = 0; k < 300; ++k) step();
  // Back on a path, while the step is held back still.
  bench.loop.aimAt(low);
  step();
  bench.loop.follow(control::TipPath({{0.0, low, {}, {}}, {0.5, high, {}, {}}}));
  for (int k = 0; k < 300; ++k) step();
  const Eigen::VectorXd before = bench.loop.turn().pressure;
  bench.loop.aimAt(here_);
  step();
  const Eigen::VectorXd begun = bench.loop.turn().pressure, reading = bench.pressure();
  EXPECT_LT((begun - before).norm(), 2e4) << "held back";
  EXPECT_GT((bench.loop.reading(0.5, begun, reading).pressure - before).norm(), 5e4);
}

TEST_F(Loop, TurnsWithoutAllocation) {
  close();
  const Eigen::VectorXd reading = bench_.pressure(), set_point = bench_.loop.turn().pressure;
  double now = bench_.time();
  bench_.loop.reading(now += 0.01, set_point, reading);
  const test::AllocationCounter counter;
  for (int k = 0; k < 25; ++k) bench_.loop.reading(now += 0.01, set_point, reading);
  EXPECT_EQ(counter.count(), 0u);
}

// What holds of a visual servo whatever it is given.

using statics::ArmModel;
using statics::Correction;

ArmModel helicalModel() { return ArmModel(test::ringArm(test::helicalRing())); }

bool isPositiveDefinite(const Eigen::MatrixXd& matrix) {
  return Eigen::LLT<Eigen::MatrixXd>(matrix).info() == Eigen::Success;
}

// Turns of gaps, outliers, NaN, repeated and old stamps, limits, vents and changes of mind.
TEST(VisualServo, StaysConsistentThroughRandomTurns) {
  const int kTurns = test::draws(20'000, 100'000);
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
  EXPECT_LT(farthest, 5);
}

// Along each direction of the arm the loop is stable if the true motion is between none and twice
// the model's, whatever latency, lag and smoothing are; and its bound lies far beyond.
TEST(VisualServo, IsStableWithinTheSmallGain) {
  const ArmModel model = helicalModel();
  const Eigen::VectorXd middle = model.arm().inputAt(Eigen::Vector3d(0.2, 0.3, 0.25));
  const Eigen::Vector3d target = model.tip(middle).tip.translation;
  test::Random random(8);
  for (int run = 0; run < test::draws(12, 40); ++run) {
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
