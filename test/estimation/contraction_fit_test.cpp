#include "helix_arm/calibration/contraction_fit.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/io/data_set.hpp"
#include "support/has.hpp"
#include "support/random.hpp"

namespace helix_arm::estimation {
namespace {

using Samples = std::vector<LengthSample>;

// Slope of the line through the ends.
double meanSlope(const model::Contraction& curve) {
  const model::Range range = curve.inputRange();
  return (curve.length(range.upper) - curve.length(range.lower)) / (range.upper - range.lower);
}

// Least slope in the direction of the trend, as a share of the mean one, on a grid that no dip of a
// quintic fits through.
double leastSlope(const model::Contraction& curve) {
  const model::Range range = curve.inputRange();
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i <= 20000; ++i) {
    const double p = std::min(range.lower + i * (range.upper - range.lower) / 20000, range.upper);
    least = std::min(least, curve.slope(p) / meanSlope(curve));
  }
  return least;
}

double quintic(const std::array<double, 6>& c, double u) {
  double sum = 0, power = 1;
  for (const double coefficient : c) {
    sum += coefficient * power;
    power *= u;
  }
  return sum;
}

// One that falls from 0 to 1 by the least slope at least: the integral of -(a^2 + u b^2 + least).
std::array<double, 6> fallingQuintic(test::Random& random, double least) {
  const double a0 = random.normal(), a1 = random.normal(), a2 = random.normal();
  const double b0 = random.normal(), b1 = random.normal();
  const double size = 0.1 * random.uniform(0, 1);
  return {0.4 + 0.1 * random.normal(),         -size * a0 * a0 - least,
          -size * (2 * a0 * a1 + b0 * b0) / 2, -size * (a1 * a1 + 2 * a0 * a2 + 2 * b0 * b1) / 3,
          -size * (2 * a1 * a2 + b1 * b1) / 4, -size * a2 * a2 / 5};
}

// Falls, and stays where it is from the given pressure on.
double kinked(double pressure, double kink) { return 0.44 - 2e-7 * std::min(pressure, kink); }

Samples kinkedSamples(double kink, int count) {
  Samples samples;
  for (int i = 0; i < count; ++i) {
    const double pressure = 400e3 * i / (count - 1);
    samples.push_back({pressure, kinked(pressure, kink)});
  }
  return samples;
}

TEST(ContractionFit, NoMonotoneQuinticIsCloser) {
  // At the least of a convex cost no feasible direction descends.
  test::Random random(3);
  Samples noisy;
  for (int i = 0; i <= 20; ++i) {
    noisy.push_back({20e3 * i, 0.4 - 0.005 * i + 1e-4 * random.normal()});
  }
  for (const bool kinked : {true, false}) {
    const Samples samples = kinked ? kinkedSamples(120e3, 21) : noisy;
    const ContractionFit fit = fitContraction(samples);
    ASSERT_EQ(fit.constrained, kinked);
    for (int trial = 0; trial < 2000; ++trial) {
      const std::array<double, 6> other = fallingQuintic(random, 1e-4);
      double descent = 0, size = 0;
      for (std::size_t i = 0; i < samples.size(); ++i) {
        const double residual = fit.residual[static_cast<Eigen::Index>(i)];
        const double step =
            quintic(other, samples[i].pressure / 400e3) - samples[i].length - residual;
        descent += residual * step;
        size += std::abs(residual * step);
      }
      EXPECT_GT(descent, -1e-3 * size) << trial;
    }
  }
}

TEST(ContractionFit, ForAnySamplesTheCurveIsMonotoneOrThereIsAReason) {
  test::Random random(4);
  int fitted = 0, constrained = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    const double noise = random.logUniform(1e-5, 1e-2), kink = random.uniform(0, 400e3);
    const double sign = random.integer(0, 1) == 0 ? -1 : 1;
    Samples samples{{0, 0.4}};
    for (int i = random.integer(5, 30); i > 0; --i) {
      const double p = 400e3 * std::pow(random.uniform(0, 1), random.logUniform(0.1, 10));
      samples.push_back({p, 0.4 + sign * 2e-7 * std::min(p, kink) + noise * random.normal()});
    }
    for (const CurveKind kind : {CurveKind::kQuintic, CurveKind::kTable}) {
      const ContractionFit fit = fitContraction(samples, {kind, Branch::kBoth});
      ASSERT_EQ(fit.reason.empty(), fit.curve.has_value()) << fit.reason;
      if (!fit.curve) continue;
      ++fitted;
      constrained += fit.constrained;
      // A table may be flat at a point, such as its end.
      ASSERT_GT(leastSlope(*fit.curve), kind == CurveKind::kQuintic ? 0 : -1e-9) << trial;
      if (kind == CurveKind::kQuintic) continue;
      for (std::size_t i = 1; i < fit.lengths.size(); ++i) {
        ASSERT_GT((fit.lengths[i] - fit.lengths[i - 1]) * meanSlope(*fit.curve), 0) << trial;
      }
    }
  }
  EXPECT_GT(fitted, 1000);
  EXPECT_GT(constrained, 500);
}

// Up and down again, longer by 4 mm on the way up except where it turns.
Samples cycle() {
  Samples samples;
  for (int i = 0; i <= 20; ++i) {
    const double u = 1 - std::abs(i - 10) / 10.0;
    const double shift = u == 0 || u == 1 ? 0.0 : (i < 10 ? 0.002 : -0.002);
    samples.push_back({u * 300e3, 0.4 - 0.1 * u + shift});
  }
  return samples;
}

TEST(ContractionFit, BranchesAreDistinguished) {
  const Samples samples = cycle();
  for (const Branch branch : {Branch::kRising, Branch::kFalling}) {
    const ContractionFit fit = fitContraction(samples, {CurveKind::kTable, branch});
    ASSERT_TRUE(fit.curve) << fit.reason;
    ASSERT_EQ(fit.pressures.size(), 11U) << "a turning point is on both branches";
    const double shift = branch == Branch::kRising ? 0.002 : -0.002;
    EXPECT_NEAR(fit.curve->length(150e3), 0.35 + shift, 1e-12);
    EXPECT_LT(fit.rms, 1e-12);
    EXPECT_EQ(fit.residual[branch == Branch::kRising ? 15 : 5], 0);
  }
}

TEST(ContractionFit, WhatTheDataDoNotAllowHasAReason) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  struct Case {
    Samples samples;
    ContractionFitOptions options;
    const char* reason;
  };
  const Samples sound = kinkedSamples(300e3, 8);
  const auto with = [&](LengthSample sample) {
    Samples samples = sound;
    samples[3] = sample;
    return samples;
  };
  Samples flat = sound;
  for (LengthSample& sample : flat) sample.length = 0.4;
  const Case cases[] = {
      {{sound.begin(), sound.begin() + 5},
       {},
       "distinct pressures: 5; expected at least 6 for a quintic: measure at more, or fit a table"},
      {with({nan, 0.4}), {}, "sample 4: the pressure is nan"},
      {flat, {}, "neither rise nor fall"},
  };
  for (const Case& c : cases) {
    const ContractionFit fit = fitContraction(c.samples, c.options);
    EXPECT_TRUE(test::has(fit.reason, c.reason));
    EXPECT_FALSE(fit.curve);
  }
}

// A published set, and the most that a fit may miss it by [m].
struct PublishedSet {
  const char* file;
  double rms;
};

class PublishedContraction : public testing::TestWithParam<PublishedSet> {};

TEST_P(PublishedContraction, IsMonotoneAndAsCloseAsPublished) {
  const std::string path = std::string(HELIX_ARM_SOURCE_DIR) + "/../shared/data/" + GetParam().file;
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is absent";
  const io::DataSet data = io::loadDataSet(path);
  Samples samples;
  for (Eigen::Index i = 0; i < data.values.rows(); ++i) {
    samples.push_back(
        {1e3 * data.values(i, data.find("pressure_kpa")), data.values(i, data.find("length_m"))});
  }
  const ContractionFit fit = fitContraction(samples);
  ASSERT_TRUE(fit.curve) << fit.reason;
  EXPECT_LE(fit.rms, GetParam().rms);
  EXPECT_GT(leastSlope(*fit.curve), 0);
  EXPECT_LT(meanSlope(*fit.curve), 0);
  const ContractionFit table = fitContraction(samples, {CurveKind::kTable, Branch::kBoth});
  ASSERT_TRUE(table.curve) << table.reason;
  EXPECT_LE(table.rms, fit.rms);
}

INSTANTIATE_TEST_SUITE_P(Sets, PublishedContraction,
                         testing::Values(PublishedSet{"free_contraction_fig3.csv", 0.70e-3},
                                         PublishedSet{"free_contraction_planar.csv", 1.35e-3}),
                         [](const auto& set) {
                           const std::string file = set.param.file;
                           return file.substr(0, file.find('.'));
                         });

}  // namespace
}  // namespace helix_arm::estimation
