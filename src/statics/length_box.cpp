#include "length_box.hpp"

#include <algorithm>

namespace helix_arm::statics {

LengthBox::LengthBox(const model::Arm& arm)
    : arm_(arm),
      at_lower_limit_(arm.actuatorCount()),
      at_upper_limit_(arm.actuatorCount()),
      lower_(arm.actuatorCount()),
      upper_(arm.actuatorCount()) {
  Eigen::VectorXd lower(arm.actuatorCount()), upper(arm.actuatorCount());
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    lower[i] = arm.actuator(i).limits.lower;
    upper[i] = arm.actuator(i).limits.upper;
  }
  limits_.resize(static_cast<std::size_t>(arm.actuatorCount()));
  limit(lower, upper);
}

void LengthBox::limit(const model::InputRef& lower, const model::InputRef& upper) noexcept {
  for (int i = 0; i < arm_.actuatorCount(); ++i) {
    const model::Contraction& contraction = arm_.actuator(i).contraction;
    limits_[static_cast<std::size_t>(i)] = {lower[i], upper[i]};
    at_lower_limit_[i] = contraction.lengthInside(lower[i]);
    at_upper_limit_[i] = contraction.lengthInside(upper[i]);
  }
  lower_ = at_lower_limit_.cwiseMin(at_upper_limit_);
  upper_ = at_lower_limit_.cwiseMax(at_upper_limit_);
}

void LengthBox::readInputs(const Eigen::VectorXd& lengths, Eigen::VectorXd& input) const noexcept {
  for (int i = 0; i < size(); ++i) {
    const model::Actuator& actuator = arm_.actuator(i);
    const model::Range& limits = this->limits(i);
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
