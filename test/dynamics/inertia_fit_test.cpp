#include "response/inertia_fit.hpp"

#include <cmath>
#include <cstdio>
#include <optional>
#include <string>

#include <gtest/gtest.h>

#include "helix_arm/dynamics/arm_motion.hpp"
#include "support/loaded_arm.hpp"
#include "support/random.hpp"
#include "support/sample_arm.hpp"
#include "support/silicone_rings.hpp"
#include "support/test_size.hpp"

namespace helix_arm::estimation {
namespace {

using dynamics::MotionConfig;

constexpr double kMass = 0.3, kTime = 0.012, kStiffness = 300;  // of the true arm

statics::Load loadOf(double mass) {
  return test::evenLoad(1, {test::kGravity, 0, 0}, mass, kStiffness);
}

MotionConfig configOf(double time) {
  MotionConfig config;
  config.damping = {time, time, time, time};
  return config;
}

// Steps of pressure of the true arm, with a noise of the tips: a rest, then two steps, at 100 Hz.
struct Recording {
  model::InputHistory history;
  Eigen::MatrixXd tips;
};

Recording recordingOf(const model::Arm& arm, test::Random& random, double noise) {
  constexpr int kRows = 600, kStep = 200;
  const dynamics::ArmMotion motion(arm, std::nullopt, loadOf(kMass), configOf(kTime));
  dynamics::InputSeries series;
  series.input.resize(kRows, 3);
  Eigen::Vector3d pressure = Eigen::Vector3d::Zero();
  for (int row = 0; row < kRows; ++row) {
    if (row % kStep == 0) {
      for (double& one : pressure) one = random.uniform(2e4, 3e5);
    }
    series.time.push_back(0.01 * row);
    series.input.row(row) = pressure;
  }
  Recording out{{series.input, series.time, std::vector<bool>(kRows, false)},
                Eigen::MatrixXd(kRows, 3)};
  motion.follow(series, dynamics::Start::kRest, series.time, [&](std::size_t row, const auto& tip) {
    for (int i = 0; i < 3; ++i) {
      out.tips(static_cast<Eigen::Index>(row), i) = tip.translation[i] + noise * random.normal();
    }
    return true;
  });
  return out;
}

// From another mass and damping, 1.96 standard errors hold the truth in about 95 % of draws.
TEST(InertiaFit, FindsMassAndDampingOfAnArmThatRings) {
  const model::Arm arm = test::softHelicalArm();
  const int draws = test::draws(12, 100);
  int mass_inside = 0, damping_inside = 0;
  double mass_error = 0, damping_error = 0;
  for (int seed = 0; seed < draws; ++seed) {
    test::Random random(static_cast<unsigned>(seed));
    const Recording recording = recordingOf(arm, random, 2e-4);
    const ModeFit rings = fitMode(recording.history, recording.tips);
    const InertiaFit fit = fitInertia(arm, std::nullopt, loadOf(0.15), configOf(0.03),
                                      recording.history, rings, {true, true});
    ASSERT_EQ(fit.failure, "") << seed;
    const double mass = fit.mass.value * 0.15 / kMass - 1,
                 time = fit.damping.value * 0.03 / kTime - 1;
    mass_inside += std::abs(mass) < 1.96 * fit.mass.standard_error * 0.15 / kMass;
    damping_inside += std::abs(time) < 1.96 * fit.damping.standard_error * 0.03 / kTime;
    mass_error = std::max(mass_error, std::abs(mass));
    damping_error = std::max(damping_error, std::abs(time));
  }
  std::printf(
      "[  FIGURE  ] %d draws: mass within its interval in %d, at most %.1f %% off; damping %d, "
      "%.1f %%\n",
      draws, mass_inside, 100 * mass_error, damping_inside, 100 * damping_error);
  EXPECT_GE(mass_inside, test::leastOf(draws, 0.9));
  EXPECT_GE(damping_inside, test::leastOf(draws, 0.9));
  EXPECT_GE(mass_inside + damping_inside, test::leastOf(2 * draws, 0.93));
  EXPECT_LE(mass_inside + damping_inside, 2 * draws - (test::isFullSize() ? 1 : 0));
  EXPECT_LT(mass_error, 0.05);
  EXPECT_LT(damping_error, 0.2);
}

// A silicone segment that is pressurised at once, as an arm of one section with masses and
// stiffness that are guesses: each pressure from the other two.
TEST(InertiaFit, PredictsHowASiliconeSegmentRingsAtAPressureThatTheFitHasNotSeen) {
  std::optional<procedures::ResponseSeries> recorded = test::siliconeRings();
  if (!recorded) GTEST_SKIP() << "no " << test::kSiliconeRings;
  procedures::ResponseSeries& series = *recorded;
  constexpr int kTrials = 3, kRows = 600;
  const model::Arm arm = test::sampleArm();
  Eigen::MatrixXd input = Eigen::MatrixXd::Zero(kTrials * kRows, 3);
  for (int row = 0; row < input.rows(); ++row) {
    if (series.history.time[row] >= 0.1) input(row, 0) = 2e4 + 1e4 * (row / kRows);
  }
  series.history.input = input;
  const ModeFit all = fitMode(series.history, series.reading);
  ASSERT_EQ(all.rings.size(), 3u);
  for (int held = 0; held < kTrials; ++held) {
    model::InputHistory seen;
    seen.input.resize((kTrials - 1) * kRows, 3);
    Eigen::MatrixXd tips(seen.input.rows(), 3);
    for (int row = 0, to = 0; row < input.rows(); ++row) {
      if (row / kRows == held) continue;
      seen.input.row(to) = input.row(row);
      tips.row(to++) = series.reading.row(row);
      seen.time.push_back(series.history.time[row]);
      seen.starts_anew.push_back(series.history.starts_anew[row]);
    }
    const statics::Load load = loadOf(0.2);
    MotionConfig config = configOf(0.004);
    const InertiaFit fit =
        fitInertia(arm, std::nullopt, load, config, seen, fitMode(seen, tips), {true, true});
    ASSERT_EQ(fit.failure, "");
    statics::Load fitted = load;
    fitted.mass.front() *= fit.mass.value;
    const double time = fit.damping.value * 0.004;
    const dynamics::ArmMotion motion(arm, std::nullopt, fitted, configOf(time));
    const RingDown& ring = all.rings[held];
    const auto found = dynamics::vibrationsOf(motion.linearisedAt(ring.input)).front();
    std::printf(
        "[  FIGURE  ] silicone segment, %d mbar: %.2f Hz, predicted %.2f; damping %.3f, predicted "
        "%.3f\n",
        200 + 100 * held, ring.frequency.value, found.frequency, ring.damping.value, found.damping);
    EXPECT_NEAR(found.frequency / ring.frequency.value, 1, 0.02);
    EXPECT_NEAR(found.damping / ring.damping.value, 1, 0.1);
  }
}

}  // namespace
}  // namespace helix_arm::estimation
