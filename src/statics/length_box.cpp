#include "length_box.hpp"

#include <algorithm>

namespace helix_arm::statics {

LengthBox::LengthBox(const model::Arm& arm)
    : arm_(arm), at_lower_limit_(arm.actuatorCount()), at_upper_limit_(arm.actuatorCount()) {
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    const model::Actuator& actuator = arm.actuator(i);
    at_lower_limit_[i] = actuator.contraction.length(actuator.limits.lower);
    at_upper_limit_[i] = actuator.contraction.length(actuator.limits.upper);
  }
  lower_ = at_lower_limit_.cwiseMin(at_upper_limit_);
  upper_ = at_lower_limit_.cwiseMax(at_upper_limit_);
}

void LengthBox::readInputs(const Eigen::VectorXd& lengths, Eigen::VectorXd& input) const noexcept {
  for (int i = 0; i < size(); ++i) {
    const model::Actuator& actuator = arm_.actuator(i);
    const model::Range& limits = actuator.limits;
    // A length at its bound maps to exactly the limit.
    if (lengths[i] == at_lower_limit_[i]) {
      input[i] = limits.lower;
    } else if (lengths[i] == at_upper_limit_[i]) {
      input[i] = limits.upper;
    } else {
      const double q = actuator.contraction.inverseInside(lengths[i], input[i]);
      input[i] = std::min(std::max(q, limits.lower), limits.upper);
    }
  }
}

}  // namespace helix_arm::statics
