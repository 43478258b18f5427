// Statistics of a fit whose equations are not positive definite.
#include "calibration/calibration_statistics.hpp"

#include <limits>

#include <gtest/gtest.h>

#include "support/sample_rig.hpp"

namespace helix_arm::estimation {
namespace {

using test::Random;

// One stiffness that the arm's captures do not change: it hangs on its prior alone.
struct Bench {
  std::vector<ArmCaptures> data;
  CalibrationOptions options;
  Selection selection;

  explicit Bench(double prior) {
    Random random(1);
    const model::Arm arm = test::ringArm(test::straightRing());
    data.push_back({"arm", arm, false, {}, {}, 0, {}});
    // As long as at rest, so that no stiffness bends or shears anything.
    for (int c = 0; c < 3; ++c) {
      const Eigen::VectorXd pressure = arm.inputAt(0.2 * c);
      test::addCapture(data[0], pressure,
                       TwistReading{arm.twists(pressure), 1e-6 * lie::Matrix6::Identity()});
    }
    options.stiffness_prior = prior;
    selection.stiffness = {StiffnessEntry::kKappa};
  }
};

constexpr double kNoPrior = std::numeric_limits<double>::infinity();
constexpr double kNoInformation = 1e200;  // noise

TEST(CalibrationStatistics, TheCovarianceIsThePriorWhereReadingsTellNothing) {
  Bench bench(0.5);
  CalibrationProblem problem(bench.data, bench.options, bench.selection);
  const Statistics found = statisticsOf(problem, 1.0);
  EXPECT_TRUE(found.determined);
  EXPECT_NEAR(found.covariance(0, 0), 0.25, 1e-6);
}

// Readings so noisy that their information is 0.
TEST(CalibrationStatistics, WithoutAPriorThereIsNoCovarianceOfWhatReadingsDoNotTell) {
  Bench bench(kNoPrior);
  CalibrationProblem problem(bench.data, bench.options, bench.selection);
  const Statistics found = statisticsOf(problem, kNoInformation);
  EXPECT_FALSE(found.determined);
  ASSERT_EQ(found.covariance.rows(), 1);
  EXPECT_TRUE(found.covariance.array().isNaN().all());
}

TEST(CalibrationStatistics, NorIsThereOneOfFreeShapesWithoutAPrior) {
  Bench bench(0.5);
  bench.options.model_prior.translation = bench.options.model_prior.rotation = kNoPrior;
  bench.selection.free_shapes = true;
  CalibrationProblem problem(bench.data, bench.options, bench.selection);
  const Statistics found = statisticsOf(problem, kNoInformation);
  EXPECT_FALSE(found.determined);
  EXPECT_TRUE(found.covariance.array().isNaN().all());
}

}  // namespace
}  // namespace helix_arm::estimation
