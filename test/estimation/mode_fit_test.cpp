#include "helix_arm/response/mode_fit.hpp"

#include <cmath>
#include <cstdio>
#include <string>

#include <gtest/gtest.h>

#include "helix_arm/basics/pi.hpp"
#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/procedures/response_series.hpp"
#include "support/has.hpp"
#include "support/random.hpp"

namespace helix_arm::estimation {
namespace {

using test::Random;

constexpr double kStroke = 0.04;  // [m]

struct Release {
  double frequency, damping, noise, rate;  // [Hz], ratio, [m], [Hz]
};

// x'' + 2 zeta w x' + w^2 x = 0 from rest at 1.
double swing(double time, double frequency, double damping) {
  const double w = 2 * basics::kPi * frequency, decay = damping * w;
  if (damping < 1) {
    const double turn = w * std::sqrt(1 - damping * damping);
    return std::exp(-decay * time) * (std::cos(turn * time) + decay / turn * std::sin(turn * time));
  }
  const double root = w * std::sqrt(damping * damping - 1), a = decay - root, b = decay + root;
  return (b * std::exp(-a * time) - a * std::exp(-b * time)) / (b - a);
}

// A second at rest, and eight after a release, with creep of an eighth at two time constants, in a
// random direction of the plane; the third coordinate follows the square of the bend.
model::InputHistory addRelease(const Release& release, unsigned seed, Eigen::MatrixXd& position) {
  Random random(seed);
  const double direction = random.uniform(0, 6), begin = 1 + random.uniform(0, 1 / release.rate);
  const double fast = random.uniform(0.6, 1.6), slow = random.uniform(5, 10);  // [s]
  const auto rows = static_cast<Eigen::Index>(9 * release.rate);
  model::InputHistory history{Eigen::MatrixXd(rows, 0), {}, std::vector<bool>(rows, false)};
  history.starts_anew[0] = true;
  position.resize(rows, 3);
  for (Eigen::Index row = 0; row < rows; ++row) {
    history.time.push_back(static_cast<double>(row) / release.rate);
    const double t = history.time.back() - begin;
    const double creep = 0.06 * (std::exp(-t / fast) + std::exp(-t / slow));
    const double x =
        t < 0 ? kStroke : kStroke * (0.88 * swing(t, release.frequency, release.damping) + creep);
    position.row(row) << x * std::cos(direction), x * std::sin(direction), x * x;
    for (int i = 0; i < 3; ++i) position(row, i) += release.noise * random.normal();
  }
  return history;
}

TEST(ModeFit, FrequencyAndDampingOfReleasesWithCreepAreWithinTheirErrors) {
  constexpr int kSeeds = 12;
  const Release cases[] = {{1, 0.03, 1e-3, 60},   {1, 0.4, 2e-4, 60},   {3, 0.1, 1e-3, 60},
                           {3, 0.2, 2e-4, 60},    {8, 0.09, 2e-4, 100}, {8, 0.2, 1e-3, 100},
                           {10, 0.03, 2e-4, 100}, {10, 0.4, 2e-4, 100}};
  int all = 0, frequencies = 0, dampings = 0;
  for (const Release& one : cases) {
    double off = 0, off_damping = 0;
    for (unsigned seed = 0; seed < kSeeds; ++seed) {
      Eigen::MatrixXd position;
      const model::InputHistory history = addRelease(one, seed, position);
      const ModeFit fit = fitMode(history, position);
      ASSERT_TRUE(fit.fitted()) << fit.failure << " " << one.frequency << " Hz " << seed;
      const double error = fit.frequency.value - one.frequency;
      const double damping_error = fit.damping.value - one.damping;
      off += error / one.frequency / kSeeds;
      off_damping += damping_error / one.damping / kSeeds;
      frequencies += std::abs(error) <= 2 * fit.frequency.standard_error;
      dampings += std::abs(damping_error) <= 2 * fit.damping.standard_error;
      ++all;
    }
    EXPECT_NEAR(off, 0, 0.02) << one.frequency << " Hz " << one.damping;
    EXPECT_NEAR(off_damping, 0, 0.08) << one.frequency << " Hz " << one.damping;
  }
  std::printf("[  FIGURE  ] frequency right in %d, damping in %d of %d\n", frequencies, dampings,
              all);
  // 95 % of 96 are 91; 84 is 3.4 standard deviations of a count less.
  EXPECT_GE(frequencies, 84);
  EXPECT_GE(dampings, 84);
}

TEST(ModeFit, AnOverdampedArmDoesNotRing) {
  for (const double damping : {1.0, 1.5, 4.0}) {
    for (const double noise : {2e-5, 2e-4, 1e-3}) {
      Eigen::MatrixXd position;
      const auto history = addRelease({3, damping, noise, 60}, 7, position);
      EXPECT_TRUE(test::has(fitMode(history, position).failure, "no ringing found in 1 release"))
          << damping << " " << noise;
    }
  }
}

TEST(ModeFit, EveryStepOfThePressureIsARelease) {
  Eigen::MatrixXd first, second, position(1080, 3);
  const Release release{3, 0.1, 2e-4, 60};
  const model::InputHistory one = addRelease(release, 1, first);
  addRelease(release, 2, second);
  position << first, second.rowwise() + (first.row(539) - second.row(0)).eval();
  model::InputHistory history{Eigen::MatrixXd(1080, 1), {}, std::vector<bool>(1080, false)};
  history.starts_anew[0] = true;
  for (int row = 0; row < 1080; ++row) {
    history.time.push_back(row / 60.0);
    history.input(row, 0) = row < 60 ? 9e4 : row < 600 ? 4e4 : 0;  // [Pa]
  }
  const ModeFit fit = fitMode(history, position);
  ASSERT_EQ(fit.rings.size(), 2u) << fit.failure;
  EXPECT_NEAR(fit.rings[0].begin, 1.08, 0.1);
  EXPECT_NEAR(fit.rings[1].begin, 10.08, 0.1);
  for (const RingDown& ring : fit.rings) EXPECT_NEAR(ring.frequency.value, 3, 0.03);
  EXPECT_LT(fit.frequency.standard_error, 0.015);
}

// Releases of a silicone segment (srl-ethz/diffPD_sim2real, MIT licence).
TEST(ModeFit, ASiliconeSegmentRings) {
  const std::string path = HELIX_ARM_SOURCE_DIR "/../shared/data/silicone_rings.csv";
  procedures::ResponseSeries series;
  try {
    series = procedures::tipSeriesOf(io::loadDataSet(path), 3);
  } catch (const io::DocumentError&) {
    GTEST_SKIP() << "no " << path;
  }
  const ModeFit fit = fitMode(series.history, series.reading);
  ASSERT_EQ(fit.rings.size(), 3u);
  EXPECT_EQ(series.trials[1], "segment-300mbar");
  const double truth[][2] = {{8.14, 0.084}, {8.15, 0.094}};
  for (int i = 0; i < 2; ++i) {
    EXPECT_NEAR(fit.rings[i].frequency.value, truth[i][0], 0.01 * truth[i][0]);
    EXPECT_NEAR(fit.rings[i].damping.value, truth[i][1], 0.05 * truth[i][1]);
  }
}

}  // namespace
}  // namespace helix_arm::estimation
