#include "helix_arm/procedures/budget_table.hpp"

#include <gtest/gtest.h>

#include "support/has.hpp"

namespace helix_arm::procedures {
namespace {

using estimation::BudgetPart;

// Standard deviations of 1 to 5 mm along x, y and z, parts in their order.
estimation::TipErrorBudget sample() {
  estimation::TipErrorBudget out;
  for (int i = 0; i < estimation::kBudgetPartCount; ++i) {
    const double mm = 1e-3 * (i + 1);
    out.parts[static_cast<std::size_t>(i)].covariance = mm * mm * Eigen::Matrix3d::Identity();
  }
  out.parts[static_cast<std::size_t>(BudgetPart::kUnexplained)].covariance.diagonal() << -4e-8,
      9e-8, 0;
  out.predicted.covariance = Eigen::Vector3d(1e-6, 4e-6, 9e-6).asDiagonal();
  out.open_loop.covariance = 1e-4 * Eigen::Matrix3d::Identity();
  out.error = Eigen::Vector3d(3e-3, 0, -4e-3);
  out.distance2 = 6.25;
  out.limit = 16.0;
  return out;
}

TEST(BudgetTable, HasTheDeviationOfEachPartAlongEachAxisAndAtWorst) {
  EXPECT_EQ(budgetTable(sample()),
            "error budget of the tip, standard deviations in mm, seen from the base\n"
            "                       x       y       z   worst\n"
            "calibration         1.00    1.00    1.00    1.00\n"
            "unexplained        -0.20    0.30    0.00    0.30\n"
            "both together       0.98    1.04    1.00    1.04\n"
            "pressure            3.00    3.00    3.00    3.00\n"
            "placement           4.00    4.00    4.00    4.00\n"
            "camera              5.00    5.00    5.00    5.00\n"
            "predicted           1.00    2.00    3.00    3.00\n"
            "open loop          10.00   10.00   10.00   10.00\n"
            "negative: a variance that is taken from the rows above, in both together\n"
            "measured - model    3.00    0.00   -4.00    5.00\n"
            "the measured tip is inside: 2.5 of 4.0 sd of open loop and camera\n");
}

TEST(BudgetTable, ItsWorstIsAlongAnyDirection) {
  estimation::TipErrorBudget budget = sample();
  budget.predicted.covariance << 1e-6, 1e-6, 0, 1e-6, 1e-6, 0, 0, 0, 0;
  EXPECT_TRUE(test::has(budgetTable(budget), "predicted           1.00    1.00    0.00    1.41\n"));
}

TEST(BudgetTable, TheTextHasALineAndItsUnitForEachRow) {
  estimation::TipErrorBudget budget = sample();
  budget.state = estimation::BudgetState::kOutside;
  budget.distance2 = 36;
  EXPECT_EQ(budgetText(budget),
            "1.00 mm calibration\n0.30 mm unexplained\n1.04 mm both together\n3.00 mm "
            "pressure\n4.00 mm placement\n"
            "5.00 mm camera\n3.00 mm predicted\n10.00 mm open loop\n5.00 mm measured - model\n"
            "outside: 6.0 of 4.0 sd");
}

}  // namespace
}  // namespace helix_arm::procedures
