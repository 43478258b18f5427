#include <limits>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "calibration/calibration_fit.hpp"
#include "calibration/shape_model.hpp"
#include "support/sample_rig.hpp"

namespace helix_arm::estimation {
namespace {

// W'W + I of random W.
Eigen::MatrixXd positive(int size, unsigned seed) {
  std::mt19937 engine(seed);
  std::normal_distribution<double> normal;
  const Eigen::MatrixXd W =
      Eigen::MatrixXd::NullaryExpr(size, size, [&](auto, auto) { return normal(engine); });
  return W.transpose() * W + Eigen::MatrixXd::Identity(size, size);
}

// Sizes on both sides of whole passes.
class UpperRoot : public testing::TestWithParam<int> {};

TEST_P(UpperRoot, SquaredIsTheMatrixWhateverItsLowerTriangle) {
  const Eigen::MatrixXd S = positive(GetParam(), 1);
  RowMajor U = S;
  U.triangularView<Eigen::StrictlyLower>().setConstant(17);
  ASSERT_TRUE(factorUpper(U));
  const Eigen::MatrixXd upper = U.triangularView<Eigen::Upper>();
  EXPECT_LT((upper.transpose() * upper - S).norm(), 1e-13 * S.norm());
}

TEST_P(UpperRoot, SolvesAndInverts) {
  const Eigen::MatrixXd S = positive(GetParam(), 2);
  RowMajor U = S;
  ASSERT_TRUE(factorUpper(U));
  const Eigen::VectorXd b = Eigen::VectorXd::LinSpaced(GetParam(), 1, 2);
  Eigen::VectorXd x = b;
  solveUpper(U, x);
  EXPECT_LT((S * x - b).norm(), 1e-10 * b.norm());
  const RowMajor C = inverseOfUpper(U);
  EXPECT_LT((S * C - Eigen::MatrixXd::Identity(GetParam(), GetParam())).norm(), 1e-9);
  EXPECT_EQ(C, RowMajor(C.transpose()));
}

INSTANTIATE_TEST_SUITE_P(Sizes, UpperRoot, testing::Values(1, 2, 3, 4, 5, 7, 8, 9, 63, 193));

TEST(UpperRootOf, AMatrixThatIsNotPositiveDefiniteDoesNotExist) {
  RowMajor S = positive(6, 3);
  S(4, 4) = -1;
  EXPECT_FALSE(factorUpper(S));
  S(4, 4) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(factorUpper(S));
}

TEST(DivideByTransposed, SolvesForEveryColumn) {
  const RowMajor S = positive(6, 4);
  RowMajor U = S;
  ASSERT_TRUE(factorUpper(U));
  const RowMajor B = RowMajor::Random(6, padded(11));
  RowMajor X = B;
  divideByTransposed(U, X);
  const Eigen::MatrixXd upper = U.triangularView<Eigen::Upper>();
  EXPECT_LT((upper.transpose() * X - B).norm(), 1e-13 * B.norm());
}

TEST(SubtractSquare, GoesToItsRowsAndColumns) {
  RowMajor W = RowMajor::Zero(2, padded(3));
  W.leftCols(3) = RowMajor::Random(2, 3);
  RowMajor S = RowMajor::Zero(5, 5);
  const std::vector<int> at = {0, 2, 3};
  std::vector<double> workspace;
  subtractSquare(W, at, workspace, S);
  const Eigen::MatrixXd expected = -W.transpose() * W;
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) EXPECT_NEAR(S(at[i], at[j]), expected(i, j), 1e-15);
  }
  EXPECT_EQ(S.row(1).norm() + S.col(1).norm() + S.col(4).norm(), 0);
}

// Statistics of a fit whose equations are not positive definite.

// One stiffness that the arm's captures do not change: it hangs on its prior alone.
struct Bench {
  std::vector<ArmCaptures> data;
  CalibrationOptions options;
  Selection selection;

  explicit Bench(double prior) {
    const model::Arm arm = test::ringArm(test::straightRing());
    data.push_back({"arm", arm, false, {}, {}, {}, {}});
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
  for (const bool free_shapes : {false, true}) {
    Bench bench(free_shapes ? 0.5 : kNoPrior);
    bench.options.model_prior.translation = bench.options.model_prior.rotation = kNoPrior;
    bench.selection.free_shapes = free_shapes;
    CalibrationProblem problem(bench.data, bench.options, bench.selection);
    const Statistics found = statisticsOf(problem, kNoInformation);
    EXPECT_FALSE(found.determined);
    ASSERT_EQ(found.covariance.rows(), free_shapes ? 0 : 1);
    EXPECT_TRUE(found.covariance.array().isNaN().all());
  }
}

}  // namespace
}  // namespace helix_arm::estimation
