#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/statics/arm_model.hpp"

namespace helix_arm::statics {

/// How far small forces move the tip of an arm.
class TipStiffness {
 public:
  /// @throws std::invalid_argument if K_eps of the arm is unknown.
  explicit TipStiffness(const ArmModel& model);

  /// Sum over the axes of the tip's motion along a force on it per force [m/N], at free lengths (n)
  /// [m]; infinite where no shape balances the load.
  double compliance(const Eigen::VectorXd& lengths) const;

 private:
  double force_;                  // on the tip [N]
  std::vector<ArmModel> pushed_;  // by it along each axis and against it
};

}  // namespace helix_arm::statics
