#pragma once

#include <string>

#include <ros/node_handle.h>

#include "helix_arm/PressureArray.h"
#include "helix_arm/TipTarget.h"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "helix_arm/regulator/realtime.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "keep_out_gate.hpp"
#include "pressure_loop.hpp"
#include "target_admission.hpp"

namespace helix_arm::ros_bridge {

/// From a target to a command: checks its values and its stamp, then whether its sender may command
/// the arm, turns shapes and tips into pressures, and commands them.
///
/// Subscribes to pressure_target, and by its TargetAdmission to the targets of tip and shape. A
/// target that is not sound, or whose sender may not command, is counted and dropped, and the
/// command stays. All of it belongs to the thread of the node's callback queue.
class TargetIntake {
 public:
  /// @param scene       Kept by reference: after a change, call adopt() before the next target.
  /// @param base_frame  Frame of tip targets.
  /// @param response    Of the arm, as it has followed the measured pressures. Kept by reference.
  /// @param loop        Takes accepted targets.
  /// @param gate        The loop's, whose nearest zone is told. Kept by reference.
  TargetIntake(ros::NodeHandle node, const io::Scene& scene, std::string base_frame,
               const model::ArmResponse& response, PressureLoop& loop, const KeepOutGate& gate);

  /// Follows a change of the scene. Whoever holds the lease keeps it.
  void adopt();

  /// A warning about a commander whose pressures look like kPa, once for each; else empty.
  std::string unitWarning() { return units_.warning(regulator::steadyNow()); }

  TargetAdmission& admission() { return admission_; }

 private:
  void onPressureTarget(const ros::MessageEvent<const PressureArray>& event);
  void aimTip(const TargetSender& sender, const TipTarget& target);

  /// The command's effective pressure. Limits the search to attainable effective pressures.
  Eigen::VectorXd beginSearch();

  /// Goes to where the result's pressures are effective.
  void follow(const TargetSender& sender, const statics::InverseResult& result);

  /// Commands it; else drops the target and returns false.
  bool command(const TargetSender& sender, const Eigen::VectorXd& pressure);

  const io::Scene& scene_;
  const std::string base_frame_;
  const model::ArmResponse& response_;
  PressureLoop& loop_;
  const KeepOutGate& gate_;
  statics::InverseSolver solver_;
  Eigen::VectorXd lower_, upper_;  // of effective pressures
  TargetAdmission admission_;
  control::UnitWatch units_;
  const ros::Subscriber subscriber_;
};

}  // namespace helix_arm::ros_bridge
