#include "arm_parameters.hpp"

#include <cmath>

namespace helix_arm::estimation {
namespace {

constexpr int kMostLengthScales = 12;  // with more actuators, one per section

bool hasEntry(const model::Arm& arm, double model::Stiffness::*entry) {
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    if (arm.actuator(i).stiffness.*entry > 0) return true;
  }
  return false;
}

}  // namespace

ArmParameters::ArmParameters(const statics::ArmModel& model, const ArmFilterOptions& options) {
  const model::Arm& arm = model.arm();
  const model::Stiffness& deviation = options.stiffness_deviation;
  if (hasEntry(arm, &model::Stiffness::gamma)) add(Entry::kGamma, "K_gamma", deviation.gamma);
  if (hasEntry(arm, &model::Stiffness::kappa)) add(Entry::kKappa, "K_kappa", deviation.kappa);
  if (hasEntry(arm, &model::Stiffness::tau)) add(Entry::kTau, "K_tau", deviation.tau);
  if (statics::takesLoad(model.choice().setting.tier)) {
    add(Entry::kEps, "K_eps", options.K_eps_deviation);
  }
  std::vector<int> rows;
  for (const Entry entry : stiffness_) rows.push_back(static_cast<int>(entry));
  correlation_ = options.stiffness_correlation(rows, rows);
  const int n = arm.actuatorCount();
  if (n <= kMostLengthScales) {
    for (int i = 0; i < n; ++i) {
      addLengths({i, i + 1}, "length of " + arm.actuator(i).name, options.length_deviation);
    }
    return;
  }
  for (int k = 0; k < arm.sectionCount(); ++k) {
    addLengths({arm.firstActuator(k), arm.firstActuator(k + 1)},
               "lengths of section " + std::to_string(k + 1), options.length_deviation);
  }
}

void ArmParameters::add(Entry entry, const char* name, double deviation) {
  stiffness_.push_back(entry);
  names_.emplace_back(name);
  deviations_.conservativeResize(count());
  deviations_[count() - 1] = deviation;
}

void ArmParameters::addLengths(Span span, const std::string& name, double deviation) {
  spans_.push_back(span);
  names_.push_back(name);
  deviations_.conservativeResize(count());
  deviations_[count() - 1] = deviation;
}

void ArmParameters::apply(const Eigen::VectorXd& theta, statics::Correction& correction) const {
  for (int j = 0; j < count(); ++j) {
    const double factor = std::exp(theta[j]);
    if (j >= stiffnessCount()) {
      const Span span = actuatorsOf(j);
      correction.length_scale.segment(span.begin, span.end - span.begin).setConstant(factor);
      continue;
    }
    switch (stiffness_[static_cast<std::size_t>(j)]) {
      case Entry::kGamma:
        correction.stiffness_factors.gamma = factor;
        break;
      case Entry::kKappa:
        correction.stiffness_factors.kappa = factor;
        break;
      case Entry::kTau:
        correction.stiffness_factors.tau = factor;
        break;
      case Entry::kEps:
        correction.K_eps_factor = factor;
        break;
    }
  }
}

}  // namespace helix_arm::estimation
