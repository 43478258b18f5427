#include "experiment_design.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cstddef>
#include <iterator>
#include <limits>
#include <numeric>

namespace helix_arm::estimation {
namespace {

// Captures that add less than this fraction of the others' information, or less than an absolute
// minimum, add nothing new.
constexpr double kNothingNew = 0.02;
constexpr double kLeastGainNats = 1e-3;
// Fractions of each actuator's range at which candidate captures are evaluated.
constexpr double kLevels[] = {0.0, 0.5, 1.0};
// Candidates of a symmetric arm differ by rounding alone: the first of them is taken [nats].
constexpr double kSameEntropy = 1e-9;
// Up to this many actuators, all combinations of levels are candidates; beyond, one actuator at a
// time and pairs.
constexpr int kMostCombined = 4;

// Columns of the parameters that affect the shape; all columns if none of these is fitted.
std::vector<int> shapeColumns(const std::vector<ParameterInfo>& infos) {
  std::vector<int> columns;
  for (std::size_t i = 0; i < infos.size(); ++i) {
    if (infos[i].about_shape) columns.push_back(static_cast<int>(i));
  }
  if (columns.empty()) {
    columns.resize(infos.size());
    std::iota(columns.begin(), columns.end(), 0);
  }
  return columns;
}

// Half the log determinant of the covariance of these columns.
double entropyOf(const Eigen::MatrixXd& information, const std::vector<int>& columns) {
  const Eigen::LLT<Eigen::MatrixXd> factors(information);
  if (factors.info() != Eigen::Success) return std::numeric_limits<double>::infinity();
  const Eigen::Index size = information.rows();
  Eigen::MatrixXd units = Eigen::MatrixXd::Zero(size, static_cast<Eigen::Index>(columns.size()));
  for (std::size_t i = 0; i < columns.size(); ++i) units(columns[i], i) = 1;
  const Eigen::MatrixXd solved = factors.solve(units);
  Eigen::MatrixXd covariance(columns.size(), columns.size());
  for (std::size_t i = 0; i < columns.size(); ++i) covariance.row(i) = solved.row(columns[i]);
  const Eigen::LLT<Eigen::MatrixXd> root(covariance);
  return root.matrixLLT().diagonal().array().log().sum();
}

double levelOf(const model::Arm& arm, int actuator, double level) {
  const model::Range& limits = arm.actuator(actuator).limits;
  return limits.lower + level * (limits.upper - limits.lower);
}

std::vector<Eigen::VectorXd> combinations(const model::Arm& arm) {
  const int n = arm.actuatorCount();
  std::vector<Eigen::VectorXd> out;
  std::vector<std::size_t> digits(n, 0);
  for (;;) {
    Eigen::VectorXd pressure(n);
    for (int i = 0; i < n; ++i) pressure[i] = levelOf(arm, i, kLevels[digits[i]]);
    out.push_back(pressure);
    int i = 0;
    while (i < n && ++digits[i] == std::size(kLevels)) digits[i++] = 0;
    if (i == n) return out;
  }
}

std::vector<Eigen::VectorXd> singlesAndPairs(const model::Arm& arm) {
  const int n = arm.actuatorCount();
  std::vector<Eigen::VectorXd> out;
  for (int i = 0; i < n; ++i) {
    for (int j = i; j < n; ++j) {
      for (const double level : kLevels) {
        Eigen::VectorXd pressure = arm.inputAt(0);
        pressure[i] = levelOf(arm, i, level);
        pressure[j] = levelOf(arm, j, level);
        out.push_back(pressure);
      }
    }
  }
  return out;
}

}  // namespace

Gains gainsOf(const CalibrationFit& fit, const Groups& groups) {
  const std::vector<int> columns = shapeColumns(fit.problem->parameters());
  const double entropy = entropyOf(fit.information, columns);
  const int count = static_cast<int>(groups.pressure.size());
  Gains gains;
  double total = 0;
  for (int g = 0; g < count; ++g) {
    const Eigen::MatrixXd own = fit.problem->information(
        fit.noise_scale, [&groups, g](int capture) { return groups.of[capture] == g; });
    gains.of.push_back(entropyOf(fit.information - own, columns) - entropy);
    total += gains.of.back();
  }
  gains.least = std::max(kLeastGainNats, kNothingNew * total / count);
  return gains;
}

std::vector<Eigen::VectorXd> nextPressures(const CalibrationFit& fit, const model::Arm& arm,
                                           int count) {
  const std::vector<int> columns = shapeColumns(fit.problem->parameters());
  const std::vector<Eigen::VectorXd> candidates =
      arm.actuatorCount() <= kMostCombined ? combinations(arm) : singlesAndPairs(arm);
  std::vector<Eigen::MatrixXd> says;
  for (const Eigen::VectorXd& pressure : candidates) {
    says.push_back(fit.problem->expectedInformation(pressure, fit.noise_scale));
  }
  Eigen::MatrixXd information = fit.information;
  std::vector<bool> taken(candidates.size(), false);
  std::vector<Eigen::VectorXd> out;
  while (static_cast<int>(out.size()) < count) {
    double least = std::numeric_limits<double>::infinity();
    std::size_t best = candidates.size();
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      if (taken[i]) continue;
      const double entropy = entropyOf(information + says[i], columns);
      if (entropy < least - kSameEntropy) {
        least = entropy;
        best = i;
      }
    }
    if (best == candidates.size()) break;
    out.push_back(candidates[best]);
    taken[best] = true;
    information += says[best];
  }
  return out;
}

}  // namespace helix_arm::estimation
