#include "budget_table.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

#include "basics/text.hpp"

namespace helix_arm::procedures {
namespace {

using estimation::BudgetPart;
using estimation::TipErrorBudget;
using estimation::TipSpread;

constexpr double kShownNegative = 5e-6;  // smaller ones are rounded to 0 [m]

struct BudgetRow {
  std::string name;
  Eigen::Vector3d axes;  // standard deviations [m]; < 0: a negative variance
  double worst;
};

BudgetRow rowOf(const char* name, const TipSpread& spread) {
  const Eigen::Vector3d variance = spread.covariance.diagonal();
  const auto root = [](double value) { return std::copysign(std::sqrt(std::abs(value)), value); };
  return {name, variance.unaryExpr(root), spread.deviation()};
}

std::string line(const char* name, const Eigen::Vector3d& axes, double worst) {
  const Eigen::Vector3d mm = 1e3 * axes;
  return basics::format("%-16s%8.2f%8.2f%8.2f%8.2f\n", name, mm.x(), mm.y(), mm.z(), 1e3 * worst);
}

// The measured error in standard deviations of what the calibration promises.
std::string verdict(const TipErrorBudget& budget) {
  return basics::format("%s: %.1f of %.1f sd", nameOf(budget.state), std::sqrt(budget.distance2),
                        std::sqrt(budget.limit));
}

std::vector<BudgetRow> budgetRows(const TipErrorBudget& budget) {
  std::vector<BudgetRow> rows;
  for (int i = 0; i < estimation::kBudgetPartCount; ++i) {
    const auto part = static_cast<BudgetPart>(i);
    rows.push_back(rowOf(nameOf(part), budget.part(part)));
    if (part != BudgetPart::kUnexplained) continue;
    TipSpread sum = budget.part(BudgetPart::kCalibration);
    sum.covariance += budget.part(part).covariance;
    rows.push_back(rowOf("both together", sum));
  }
  rows.push_back(rowOf("predicted", budget.predicted));
  rows.push_back(rowOf("open loop", budget.open_loop));
  return rows;
}

}  // namespace

std::string budgetTable(const TipErrorBudget& budget) {
  std::string out = "error budget of the tip, standard deviations in mm, seen from the base\n" +
                    basics::format("%-16s%8s%8s%8s%8s\n", "", "x", "y", "z", "worst");
  const std::vector<BudgetRow> rows = budgetRows(budget);
  for (const BudgetRow& row : rows) out += line(row.name.c_str(), row.axes, row.worst);
  if (std::any_of(rows.begin(), rows.end(), [](const BudgetRow& row) {
        return (row.axes.array() < -kShownNegative).any();
      })) {
    out += "negative: a variance that is taken from the rows above, in both together\n";
  }
  out += line("measured - model", budget.error, budget.error.norm());
  return out + "the measured tip is " + verdict(budget) + " of open loop and camera\n";
}

std::string driftText(const estimation::Drift& drift) {
  return basics::format(
      "the measured tip is %.1f mm from what was learnt %.0f s ago, beyond the %.1f mm "
      "that creep, hysteresis and noise explain: the camera or the base may have moved, a "
      "load may have come slowly, or the arm has changed; check them, then call ~reset to "
      "accept what is seen, or calibrate again",
      1e3 * drift.distance, drift.age, 1e3 * drift.allowed);
}

std::string budgetText(const TipErrorBudget& budget) {
  std::string out = "error budget, 1 sd\n";
  for (const BudgetRow& row : budgetRows(budget)) {
    out += basics::format("%.2f mm %s\n", 1e3 * row.worst, row.name.c_str());
  }
  out += basics::format("%.2f mm measured - model\n", 1e3 * budget.error.norm());
  return out + verdict(budget);
}

}  // namespace helix_arm::procedures
