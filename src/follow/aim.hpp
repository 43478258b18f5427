#pragma once

#include <Eigen/Core>

#include "helix_arm/follow/visual_servo.hpp"
#include "helix_arm/statics/correction.hpp"
#include "helix_arm/statics/inverse.hpp"

namespace helix_arm::follow {

/// The tip that a target asks for; the identity as orientation if that is free.
lie::SE3 tipOf(const Target& target, const model::Arm& arm);

/// Limits of the actuators' pressures (n) [Pa].
Eigen::VectorXd lowestPressures(const model::Arm& arm);
Eigen::VectorXd highestPressures(const model::Arm& arm);

/// From a wanted tip to pressures: the inverse of a corrected model whose correction never jumps.
class Aim {
 public:
  /// @param nearby  preference of searches near the last pressures.
  Aim(const statics::ArmModel& model, statics::Preference nearby);

  /// A new goal of the correction. Its factors hold at once; the offset makes up for them at the
  /// last pressures, and goes to the goal's by approach().
  void learn(const statics::Correction& goal);
  /// Moves the offset towards the goal by a share in [0, 1].
  void approach(double share);

  /// Pressures for a target. @param fresh  searches everywhere, not only near the last pressures.
  const statics::InverseResult& solve(const Target& target, bool fresh);
  /// From now on pressures (n) are searched between these, which are within the arm's limits.
  void limit(const Eigen::VectorXd& lower, const Eigen::VectorXd& upper);
  /// The next search begins at these pressures (n) [Pa], clamped to the limits.
  void startAt(const Eigen::VectorXd& pressure);
  /// Last solution (n) [Pa].
  const Eigen::VectorXd& pressure() const { return pressure_; }

  /// How a target moves, base frame.
  struct Motion {
    Eigen::Vector3d velocity, acceleration;  ///< [m/s], [m/s^2]
  };
  /// Lateness of actuators beyond the responses of the scene [s].
  struct Late {
    double dead_time, lag;
  };
  /// Pressures (n) with which the tip follows a moving target, up to second order: the last
  /// solution, led by the time constant of the regulator [s], the lags of the actuators, what they
  /// are late beyond these, and a mode, inside the limits.
  const Eigen::VectorXd& led(const Motion& target, double time_constant, const Late& beyond,
                             const std::optional<estimation::Mode>& mode);

 private:
  const Eigen::VectorXd& lengthsAt(const Eigen::VectorXd& pressure);

  const model::Arm arm_;
  const statics::ArmModel model_;
  statics::InverseSolver everywhere_, nearby_;
  statics::CorrectedModel corrected_;
  statics::Correction now_;
  model::Twists goal_;  // of the offset
  Eigen::VectorXd lower_, upper_;
  Eigen::VectorXd pressure_, led_, lengths_;
  Eigen::MatrixXd by_lengths_;  // (6 x n)
  Eigen::Matrix3Xd by_pressure_;
};

}  // namespace helix_arm::follow
