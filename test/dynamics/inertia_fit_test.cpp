#include "helix_arm/response/inertia_fit.hpp"

#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>

#include <gtest/gtest.h>

#include "helix_arm/dynamics/arm_motion.hpp"
#include "support/loaded_arm.hpp"
#include "support/random.hpp"
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
  const int draws = test::draws(12, 50);
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
  EXPECT_LT(mass_error, 0.05);
  EXPECT_LT(damping_error, 0.2);
}

}  // namespace
}  // namespace helix_arm::estimation
