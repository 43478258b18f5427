#include "helix_arm/procedures/pressure_plan.hpp"

#include <array>

namespace helix_arm::procedures {
namespace {

constexpr std::array<double, 12> kLevels = {0, 10, 15, 20, 25, 30, 35, 40, 45, 50, 55, 60};  // psi

control::Refusal refuse(control::Fault fault, const std::string& message) {
  return {fault, message};
}

}  // namespace

Eigen::MatrixXd defaultPressurePlan(const model::Arm& arm) {
  const int count = arm.actuatorCount();
  const auto levels = static_cast<int>(kLevels.size());
  Eigen::MatrixXd plan = arm.inputAt(0).transpose().replicate(levels, 1);
  for (int step = 0; step < levels; ++step) {
    const int i = step % count;
    const model::Range& limits = arm.actuator(i).limits;
    const double share = kLevels[static_cast<std::size_t>(step)] / kLevels.back();
    plan(step, i) = limits.lower + share * (limits.upper - limits.lower);
  }
  return plan;
}

Eigen::MatrixXd risingPressurePlan(const model::Arm& arm) {
  const Eigen::MatrixXd plan = defaultPressurePlan(arm);
  Eigen::MatrixXd rising(plan.rows(), plan.cols());
  Eigen::Index step = 0;
  for (Eigen::Index i = 0; i < plan.cols(); ++i) {
    for (Eigen::Index k = i; k < plan.rows(); k += plan.cols()) rising.row(step++) = plan.row(k);
  }
  return rising;
}

Eigen::MatrixXd thereAndBack(const Eigen::MatrixXd& plan) {
  Eigen::MatrixXd out(2 * plan.rows() - 1, plan.cols());
  out << plan, plan.topRows(plan.rows() - 1).colwise().reverse();
  return out;
}

control::Checked<Eigen::MatrixXd> checkPlan(const model::Arm& arm, const std::vector<double>& rows,
                                            bool loop) {
  if (rows.empty()) return loop ? thereAndBack(risingPressurePlan(arm)) : defaultPressurePlan(arm);
  const auto count = static_cast<std::size_t>(arm.actuatorCount());
  if (rows.size() % count != 0) {
    return refuse(control::Fault::kWrongSize,
                  "a plan of " + std::to_string(rows.size()) + " pressures for " +
                      std::to_string(count) +
                      " actuators; send one per step and actuator, row by row");
  }
  Eigen::MatrixXd plan(rows.size() / count, count);
  for (Eigen::Index step = 0; step < plan.rows(); ++step) {
    const auto first = rows.begin() + step * plan.cols();
    const auto checked = control::checkPressures(arm, Eigen::VectorXd::Zero(plan.cols()), {},
                                                 std::vector<double>(first, first + plan.cols()));
    if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
      return refuse(refusal->fault,
                    "step " + std::to_string(step + 1) + " of the plan: " + refusal->message);
    }
    plan.row(step) = std::get<Eigen::VectorXd>(checked);
  }
  if ((plan.rowwise() - plan.row(0)).isZero(0.0)) {
    return refuse(control::Fault::kOutOfRange,
                  "a plan of one pressure, which cannot distinguish parameters; send at least two "
                  "different pressures");
  }
  return loop ? thereAndBack(plan) : plan;
}

}  // namespace helix_arm::procedures
