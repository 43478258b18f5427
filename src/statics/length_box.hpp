#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/model/arm.hpp"

namespace helix_arm::statics {

/// Range of the actuators' lengths [m] within the limits of their inputs, one interval per
/// actuator; at first those of the arm. Keeps a reference to the arm.
class LengthBox {
 public:
  explicit LengthBox(const model::Arm& arm);

  /// Narrows the limits of the inputs to lower .. upper (n), which are within the arm's.
  void limit(const model::InputRef& lower, const model::InputRef& upper) noexcept;
  /// Limits of an input.
  const model::Range& limits(int i) const { return limits_[static_cast<std::size_t>(i)]; }

  int size() const { return static_cast<int>(lower_.size()); }
  /// (n) [m]
  const Eigen::VectorXd& lower() const { return lower_; }
  const Eigen::VectorXd& upper() const { return upper_; }

  /// Inputs (n) that give lengths (n) [m] inside the box.
  /// @param input  initial guesses, replaced by the result.
  void readInputs(const Eigen::VectorXd& lengths, Eigen::VectorXd& input) const noexcept;

 private:
  const model::Arm& arm_;
  std::vector<model::Range> limits_;
  Eigen::VectorXd at_lower_limit_, at_upper_limit_;  // lengths at the limits of the inputs [m]
  Eigen::VectorXd lower_, upper_;                    // of the lengths [m]
};

}  // namespace helix_arm::statics
