#include "helix_arm/tracking/response_estimator.hpp"

#include <Eigen/Core>
#include <cmath>
#include <optional>
#include <ostream>

#include <gtest/gtest.h>

#include "basics/pi.hpp"
#include "estimation/tracked_arm.hpp"
#include "support/random.hpp"

namespace helix_arm::estimation {
namespace {

constexpr double kStep = 1e-3;     // of the true arm [s]
constexpr int kPictureEvery = 33;  // steps
constexpr double kNoise = 0.05;    // of a picture, in units of its expected errors

struct TrueArm {
  double lag = 0.0;  // [s]
  std::optional<Mode> mode = {};
  double play = 0.0;  // half the width [Pa]
};
std::ostream& operator<<(std::ostream& out, const TrueArm& arm) {
  out << "lag " << arm.lag << " s, play " << arm.play << " Pa";
  if (arm.mode) out << ", " << arm.mode->frequency << " Hz, damping " << arm.mode->damping;
  return out;
}

// Steps of random pressures every two seconds, through the lag, the play and the mode, whose
// frequency goes with 1 / length, in steps of a millisecond. The effect of each actuator differs
// from the model's by up to 30 %.
ResponseEstimator after(double seconds, const TrueArm& truth, bool known_response,
                        double pause = 0.0) {
  const model::Arm arm = helicalModel().arm();
  const int n = arm.actuatorCount();
  test::Random random(4);
  Eigen::MatrixXd by_lengths(6, n);
  for (double& entry : by_lengths.reshaped()) entry = 100 * random.normal();
  Eigen::VectorXd gain(n);
  for (double& entry : gain) entry = random.uniform(0.7, 1.3);

  ResponseEstimator estimator(arm, known_response, std::nullopt);
  Eigen::VectorXd target = arm.inputAt(0.0), pressure = target, lengths = arm.lengths(target),
                  rate = Eigen::VectorXd::Zero(n), known = target, played = target;
  Eigen::MatrixXd history(n, kPictureEvery + 1);
  for (int i = 0; i * kStep < seconds; ++i) {
    const double time = i * kStep + (i * kStep > seconds / 2 ? pause : 0.0);
    if (i % 2000 == 0) {
      for (int j = 0; j < n; ++j) {
        target[j] = random.uniform(arm.actuator(j).limits.lower, arm.actuator(j).limits.upper);
      }
    }
    // The regulator takes 0.05 s.
    known += kStep / 0.05 * (target - known);
    pressure += (truth.lag > 0 ? kStep / truth.lag : 1.0) * (known - pressure);
    played = played.array().max(pressure.array() - truth.play).min(pressure.array() + truth.play);
    const Eigen::VectorXd goal = arm.lengths(arm.clamped(played));
    if (truth.mode) {
      const double rest = arm.lengths(arm.inputAt(0.0)).mean();
      const double turn = 2 * basics::kPi * truth.mode->frequency * rest / goal.mean();
      rate += kStep * (turn * turn * (goal - lengths) - 2 * truth.mode->damping * turn * rate);
      lengths += kStep * rate;
    } else {
      lengths = goal;
    }
    history.col(i % (kPictureEvery + 1)) = known_response ? played : known;
    if (i % kPictureEvery != 0) continue;
    Eigen::VectorXd then;
    estimator.moveTo(time, [&](double when) -> const Eigen::VectorXd& {
      const int back = static_cast<int>(std::lround((time - when) / kStep));
      return then = history.col((i - std::min({back, i, kPictureEvery})) % (kPictureEvery + 1));
    });
    Eigen::VectorXd measured = by_lengths * gain.cwiseProduct(lengths);
    for (double& entry : measured) entry += kNoise * random.normal();
    estimator.compare(measured, by_lengths);
  }
  return estimator;
}

class FoundMode : public testing::TestWithParam<TrueArm> {};

TEST_P(FoundMode, IsThatOfTheArm) {
  const TrueArm& truth = GetParam();
  for (const bool known : {false, true}) {
    const auto found = after(30, truth, known).mode();
    ASSERT_TRUE(found) << "response known: " << known;
    EXPECT_NEAR(found->frequency, truth.mode->frequency, 0.05 * truth.mode->frequency);
    EXPECT_NEAR(std::log(found->damping / truth.mode->damping), 0, std::log(2));
    EXPECT_GT(found->frequency_deviation, 0);
    EXPECT_LT(found->frequency_deviation, 0.05 * found->frequency);
  }
}

INSTANTIATE_TEST_SUITE_P(Arms, FoundMode,
                         testing::Values(TrueArm{0.0, Mode{1.5, 0.05}},
                                         TrueArm{0.3, Mode{1.5, 0.1}}, TrueArm{0.1, Mode{0.9, 0.1}},
                                         TrueArm{0.1, Mode{3.0, 0.1}},
                                         TrueArm{0.05, Mode{4.5, 0.05}}));

TEST(ResponseEstimator, KnowsLagAndPlayAfterAMinute) {
  for (const double lag : {0.02, 0.1, 0.2}) {
    for (const double play : {0.0, 5e3}) {
      const TrueArm truth{lag, std::nullopt, play};
      SCOPED_TRACE(testing::PrintToString(truth));
      const ResponseEstimator estimator = after(60, truth, false);
      EXPECT_NEAR(estimator.lag().value, lag, 0.01);
      EXPECT_LT(estimator.lag().deviation, 0.015);
      EXPECT_NEAR(estimator.play().value, play, 1500);
    }
  }
  const ResponseEstimator known = after(20, {0.1, std::nullopt, 5e3}, true);
  EXPECT_EQ(known.lag().deviation, 0);
  EXPECT_EQ(known.play().value, 0);
}

// Its derivatives hold near by alone, and it begins without a lag: the bank leads it there.
TEST(ResponseEstimator, ALongLagIsKnownFromTheFirstStep) {
  for (const double lag : {0.2, 0.3, 0.4}) {
    EXPECT_NEAR(after(1.9, {lag}, false).lag().value, lag, 0.05);
  }
}

// The begin of a slow swing looks like a lag of 0.3 s.
TEST(ResponseEstimator, ASlowModeIsNotTakenForALag) {
  for (double time = 0.5; time < 3; time += 0.25) {
    EXPECT_LT(after(time, {0.1, Mode{1.5, 0.05}}, false).lag().value, 0.2) << time;
  }
}

TEST(ResponseEstimator, AnArmThatOnlyLagsHasNoMode) {
  for (const double lag : {0.0, 0.07, 0.15, 0.3}) {
    EXPECT_FALSE(after(20, {lag}, false).mode()) << lag;
  }
  EXPECT_FALSE(after(20, {0.2}, true).mode());
  // Half a second after a step, it might swing unless earlier steps have refuted that.
  EXPECT_GT(after(0.5, {0.1}, false).possibleSwing().maxCoeff(), 0.005);
  EXPECT_LT(after(20.5, {0.1}, false).possibleSwing().maxCoeff(), 0.001);
}

TEST(ResponseEstimator, APauseStartsAtRestAndKeepsTheMode) {
  EXPECT_NEAR(after(30, {0.1, Mode{2.0, 0.1}}, false, 5.0).mode().value().frequency, 2.0, 0.1);
}

}  // namespace
}  // namespace helix_arm::estimation
