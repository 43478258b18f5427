// Muscles on a testing machine: a law that is found again, and the measured one.
#include "calibration/stand_fit.hpp"

#include <filesystem>

#include <gtest/gtest.h>

#include "helix_arm/io/data_set.hpp"
#include "support/random.hpp"

namespace helix_arm::estimation {
namespace {

// A bellows of 60 mm at rest that lengthens by 1.5 mm/kPa; K_eps rises from 10 to 25 N at 40 kPa.
double lengthOf(double p) { return 0.06 + 1.5e-6 * p; }
double stiffnessOf(double p) { return 10 + 15 * std::min(p / 40e3, 1.0); }

// Ramps up and down at each length.
StandRun ramps(int muscles, double noise, unsigned seed) {
  test::Random random(seed);
  StandRun out{"run " + std::to_string(seed), {}};
  for (const double length : {0.05, 0.07, 0.09}) {
    for (int i = 0; i < 240; ++i) {
      const double p = 80e3 * (i < 120 ? i : 239 - i) / 119.0;
      const double force = muscles * stiffnessOf(p) * (length - lengthOf(p)) / 0.06;
      out.readings.push_back({p, length, force + noise * random.normal()});
    }
  }
  return out;
}

TEST(StandFit, FindsTheLawOfOneMuscleWithItsErrors) {
  const int muscles = 4;
  const StandFit fit = fitStand({ramps(muscles, 0.5, 1), ramps(muscles, 0.5, 2)}, muscles);
  ASSERT_TRUE(fit.law) << fit.reason;
  ASSERT_EQ(fit.pressures.size(), 7u);
  for (std::size_t k = 0; k < fit.pressures.size(); ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    EXPECT_NEAR(fit.lengths[i], lengthOf(fit.pressures[k]), 4 * fit.lengths_error[i]);
    EXPECT_NEAR(fit.K_eps[i], stiffnessOf(fit.pressures[k]), 4 * fit.K_eps_error[i] + 0.1);
    EXPECT_LT(fit.K_eps_error[i], 0.5);
  }
  EXPECT_NEAR(fit.rms, 0.5, 0.05);
  ASSERT_EQ(fit.held_out.size(), 2u);
  EXPECT_EQ(fit.held_out[0].first, "run 1");
  EXPECT_NEAR(fit.held_out_rms, 0.5, 0.05);
  EXPECT_NEAR(muscles * fit.law->force(40e3, 0.08), muscles * 25 * (0.08 - 0.12) / 0.06, 1.0);
}

// RMS of the authors' cubic surface within the run: 6.3 N; of a constant K: 11.1 N.
TEST(StandFit, FourBellowsOfTheFacilityAreLinearInStrain) {
  const std::string path =
      std::string(HELIX_ARM_SOURCE_DIR) + "/../shared/data/flp/four_bellows_run1.csv";
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is absent";
  const io::DataSet data = io::loadDataSet(path);
  StandRun run{"run 1", {}};
  for (Eigen::Index row = 0; row < data.values.rows(); ++row) {
    run.readings.push_back({1e3 * data.values(row, data.find("pressure_kpa")),
                            data.values(row, data.find("length_m")),
                            data.values(row, data.find("force_n"))});
  }
  const StandFit fit = fitStand({run}, 4);
  ASSERT_TRUE(fit.law) << fit.reason;
  EXPECT_LT(fit.rms, 6.5);
  EXPECT_LT(fit.held_out_rms, 7.2);
  EXPECT_NEAR(fit.law->contraction.restLength(), 0.06, 0.003);
  // Rows alternate in blocks of ten seconds: what is fitted to every other block predicts the rest.
  StandRun even{"even", {}}, odd{"odd", {}};
  for (std::size_t i = 0; i < run.readings.size(); ++i) {
    (i / 50 % 2 == 0 ? even : odd).readings.push_back(run.readings[i]);
  }
  EXPECT_LT(compareStand(*fitStand({even}, 4).law, odd, 4).rms, 7.2);
}

}  // namespace
}  // namespace helix_arm::estimation
