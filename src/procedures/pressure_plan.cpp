#include "pressure_plan.hpp"

#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

#include "basics/pi.hpp"

namespace helix_arm::procedures {
namespace {

constexpr std::array<double, 12> kLevels = {0, 10, 15, 20, 25, 30, 35, 40, 45, 50, 55, 60};  // psi

using control::Fault;
using control::Refusal;

constexpr double kFullAngle = 2 * basics::kPi;
constexpr int kStops = 12;  // on the way around

// The default plan actuator by actuator, ascending in each.
Eigen::MatrixXd risingPressurePlan(const model::Arm& arm) {
  const Eigen::MatrixXd plan = defaultPressurePlan(arm);
  Eigen::MatrixXd rising(plan.rows(), plan.cols());
  Eigen::Index step = 0;
  for (Eigen::Index i = 0; i < plan.cols(); ++i) {
    for (Eigen::Index k = i; k < plan.rows(); k += plan.cols()) rising.row(step++) = plan.row(k);
  }
  return rising;
}

// The steps of a plan and then the same in reverse; the last one is not repeated.
Eigen::MatrixXd thereAndBack(const Eigen::MatrixXd& plan) {
  Eigen::MatrixXd out(2 * plan.rows() - 1, plan.cols());
  out << plan, plan.topRows(plan.rows() - 1).colwise().reverse();
  return out;
}

}  // namespace

Eigen::MatrixXd defaultPressurePlan(const model::Arm& arm) {
  const int count = arm.actuatorCount();
  Eigen::MatrixXd plan(kLevels.size(), count);
  for (Eigen::Index step = 0; step < plan.rows(); ++step) {
    const double share = kLevels[static_cast<std::size_t>(step)] / kLevels.back();
    plan.row(step) = arm.inputAt(share * Eigen::VectorXd::Unit(count, step % count));
  }
  return plan;
}

control::Checked<Eigen::MatrixXd> checkPlan(const model::Arm& arm, const std::vector<double>& rows,
                                            bool loop) {
  if (rows.empty()) return loop ? thereAndBack(risingPressurePlan(arm)) : defaultPressurePlan(arm);
  const auto count = static_cast<std::size_t>(arm.actuatorCount());
  if (rows.size() % count != 0) {
    return Refusal{Fault::kWrongSize, "a plan of " + std::to_string(rows.size()) +
                                          " pressures for " + std::to_string(count) +
                                          " actuators; send one per step and actuator, row by row"};
  }
  Eigen::MatrixXd plan(rows.size() / count, count);
  for (Eigen::Index step = 0; step < plan.rows(); ++step) {
    const auto first = rows.begin() + step * plan.cols();
    const auto checked = control::checkPressures(arm, Eigen::VectorXd::Zero(plan.cols()), {},
                                                 std::vector<double>(first, first + plan.cols()));
    if (const auto* refusal = std::get_if<Refusal>(&checked)) {
      return Refusal{refusal->fault,
                     "step " + std::to_string(step + 1) + " of the plan: " + refusal->message};
    }
    plan.row(step) = std::get<Eigen::VectorXd>(checked);
  }
  if ((plan.rowwise() - plan.row(0)).isZero(0.0)) {
    return Refusal{Fault::kOutOfRange,
                   "a plan of one pressure, which cannot distinguish parameters; send at least two "
                   "different pressures"};
  }
  return loop ? thereAndBack(plan) : plan;
}

Eigen::MatrixXd pressureTour(const model::Arm& arm, double fraction) {
  if (!(fraction > 0 && fraction <= 1)) {
    throw std::invalid_argument("a tour over " + std::to_string(fraction) +
                                " of the range; expected a fraction in (0, 1]");
  }
  // Rows: rest, the stops of one turn with the first repeated, all actuators together, rest.
  Eigen::MatrixXd share = Eigen::MatrixXd::Zero(kStops + 4, arm.actuatorCount());
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const int first = arm.firstActuator(k), count = arm.firstActuator(k + 1) - first;
    for (int i = 0; i < count; ++i) {
      const double place = static_cast<double>(i) / count + 0.5 * (k % 2);
      for (int stop = 0; stop <= kStops; ++stop) {
        const double angle = kFullAngle * (static_cast<double>(stop) / kStops - place);
        share(1 + stop, first + i) = 0.5 * (1.0 + std::cos(angle));
      }
      share(kStops + 2, first + i) = 0.5;
    }
  }
  Eigen::MatrixXd tour(share.rows(), share.cols());
  for (Eigen::Index row = 0; row < tour.rows(); ++row) {
    tour.row(row) = arm.inputAt(Eigen::VectorXd(fraction * share.row(row)));
  }
  return tour;
}

}  // namespace helix_arm::procedures
