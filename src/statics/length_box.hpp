#pragma once

#include <Eigen/Core>

#include "helix_arm/model/arm.hpp"

namespace helix_arm::statics {

/// Range of the actuators' lengths [m] within the limits of their inputs, one interval per
/// actuator. Keeps a reference to the arm.
class LengthBox {
 public:
  explicit LengthBox(const model::Arm& arm);

  int size() const { return static_cast<int>(lower_.size()); }
  /// (n) [m]
  const Eigen::VectorXd& lower() const { return lower_; }
  const Eigen::VectorXd& upper() const { return upper_; }

  /// Inputs (n) that give lengths (n) [m] inside the box.
  /// @param input  initial guesses, replaced by the result.
  void readInputs(const Eigen::VectorXd& lengths, Eigen::VectorXd& input) const noexcept;

 private:
  const model::Arm& arm_;
  Eigen::VectorXd at_lower_limit_, at_upper_limit_;  // lengths at the limits of the inputs [m]
  Eigen::VectorXd lower_, upper_;                    // of the lengths [m]
};

}  // namespace helix_arm::statics
