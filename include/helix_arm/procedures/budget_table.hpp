#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "helix_arm/tracking/error_budget.hpp"
#include "helix_arm/tracking/load_forks.hpp"

namespace helix_arm::procedures {

/// A row of an error budget for people.
struct BudgetRow {
  std::string name;      ///< "calibration" .., "predicted", "open loop"; see budgetRows()
  Eigen::Vector3d axes;  ///< standard deviation along x, y, z of the base; < 0: a negative variance
  double worst;          ///< standard deviation along the worst direction [m]
};

/// The parts in their order, predicted, open loop. After calibration and unexplained their sum,
/// "both together": only that is a covariance.
std::vector<BudgetRow> budgetRows(const estimation::TipErrorBudget& budget);

/// A table in mm, for letters of one width; ends in a new line.
std::string budgetTable(const estimation::TipErrorBudget& budget);
/// The worst directions in mm, the measured error and what the budget says of it, one in a line:
/// for letters of any width.
std::string budgetText(const estimation::TipErrorBudget& budget);

/// Why the pictures are doubted while Drift::doubtful, and the remedy.
std::string driftText(const estimation::Drift& drift);

}  // namespace helix_arm::procedures
