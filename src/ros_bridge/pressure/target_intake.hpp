#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <variant>

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/message_event.h>
#include <ros/node_handle.h>
#include <ros/time.h>

#include "helix_arm/PressureArray.h"
#include "helix_arm/ShapeTarget.h"
#include "helix_arm/TargetStatus.h"
#include "helix_arm/TipTarget.h"
#include "helix_arm/control/commander_lease.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/diagnostics.hpp"

namespace helix_arm::ros_bridge {

/// Who sent which target.
struct TargetSender {
  std::string topic;
  std::string commander;
  ros::Time stamp;
};

/// What the inverse makes of a target.
struct TargetSolution {
  statics::InverseStatus status;
  double residual;                            ///< norm of the weighted error [m]
  double position_error;                      ///< distance from the commanded tip to the target [m]
  const std::vector<statics::Limit>& limits;  ///< (n)
};

/// Decides whose targets are taken, by their stamps and a lease, and publishes target_status: one
/// answer per target. Counts them, and warns of those that are dropped or out of reach.
class TargetAdmission {
 public:
  /// @param scene  Its arm and safety rules are used. Kept by reference: after a change to it, call
  ///               adopt() before the next target.
  TargetAdmission(ros::NodeHandle& node, const io::Scene& scene);

  /// Follows a change of the scene. Whoever holds the lease keeps it.
  void adopt();

  /// What was checked, unless its stamp says that it waited in some queue.
  template <class T>
  control::Checked<T> fresh(const TargetSender& sender, control::Checked<T> checked) const {
    auto refusal = ageRefusal(sender);
    return refusal ? control::Checked<T>(*std::move(refusal)) : std::move(checked);
  }

  /// The target's value when it is sound and its sender may command; else drops it and returns
  /// null.
  template <class T>
  const T* admit(const TargetSender& sender, const control::Checked<T>& checked) {
    // Checked before the lease: nonsense neither takes nor keeps it.
    const auto* refusal = std::get_if<control::Refusal>(&checked);
    if (refusal != nullptr) {
      drop(sender, *refusal);
      return nullptr;
    }
    if (const auto other = claim(sender.commander)) {
      drop(sender, *other);
      return nullptr;
    }
    return &std::get<T>(checked);
  }

  /// Grants or renews the lease of a commander, or says who holds it.
  std::optional<control::Refusal> claim(const std::string& commander);

  void drop(const TargetSender& sender, const control::Refusal& refusal);
  /// Answers a target that the command realises.
  void accept(const TargetSender& sender);
  /// Answers a target by its inverse: reached, or out of reach and replaced by the closest.
  void accept(const TargetSender& sender, const TargetSolution& solution);

  /// The status `<node>: targets`: WARN if a target was dropped or out of reach since the last
  /// call.
  diagnostic_msgs::DiagnosticStatus status();

 private:
  std::optional<control::Refusal> ageRefusal(const TargetSender& sender) const;
  /// At most one line per fault and period.
  void warn(FaultCount& count, const TargetSender& sender, const std::string& message,
            const char* consequence);

  const io::Scene& scene_;
  control::CommanderLease lease_;
  std::uint64_t reached_ = 0;
  FaultCount unreachable_;
  std::array<FaultCount, control::kFaultCount> dropped_;
  std::string last_fault_;
  bool news_ = false;  ///< a target was dropped or out of reach since the last status
  ros::Publisher publisher_;
};

/// The refusal of a target for which the inverse finds no pressures.
control::Refusal notConverged();

/// From a target to a command: checks its values and its stamp, then whether its sender may command
/// the arm, turns shapes and tips into pressures, and commands them.
///
/// Subscribes to pressure_target, shape_target and tip_target; publishes target_status, one answer
/// per target. A target that is not sound, or whose sender may not command, is counted and dropped,
/// and the command stays. All of it belongs to the thread of the node's callback queue.
class TargetIntake {
 public:
  /// Where accepted targets go.
  struct Commands {
    std::function<Eigen::VectorXd()> goal;  ///< (n) where the arm goes now [Pa]
    /// Takes (n) [Pa], inside the limits, of a commander; or refuses it.
    std::function<std::optional<control::Refusal>(const std::string& commander,
                                                  const Eigen::VectorXd& pressure)>
        send;
  };

  /// @param scene       Its arm, model and safety rules are used. Kept by reference: after a change
  ///                    to it, call adopt() before the next target.
  /// @param base_frame  Frame of tip targets.
  /// @param response    Of the arm, as it has followed the measured pressures. Kept by reference.
  TargetIntake(ros::NodeHandle node, const io::Scene& scene, std::string base_frame,
               const model::ArmResponse& response, Commands commands);

  /// A target from the interactive marker, whose stamp is not checked.
  void takeFromHandle(const TipTarget& target);

  /// Follows a change of the scene. Whoever holds the lease keeps it.
  void adopt() {
    admission_.adopt();
    solver_ = statics::InverseSolver(scene_.model);
  }

  /// A warning about a commander whose pressures look like kPa, once for each; else empty.
  std::string unitWarning();

  /// As TargetAdmission::status().
  diagnostic_msgs::DiagnosticStatus status() { return admission_.status(); }

 private:
  void onPressureTarget(const ros::MessageEvent<const PressureArray>& event);
  void onShapeTarget(const ros::MessageEvent<const ShapeTarget>& event);
  void onTipTarget(const ros::MessageEvent<const TipTarget>& event);
  void aimTip(const TargetSender& sender, const control::Checked<TipGoal>& checked);

  /// Where the search begins: the effective pressure of the present command. Limits the search to
  /// attainable effective pressures.
  Eigen::VectorXd beginSearch() {
    if (response_.instant()) return commands_.goal();
    response_.effectiveLimits(scene_.arm, lower_, upper_);
    solver_.limit(lower_, upper_);
    return response_.effectiveAt(commands_.goal()).cwiseMax(lower_).cwiseMin(upper_);
  }
  /// Goes to where the result's pressures are effective.
  void follow(const TargetSender& sender, const statics::InverseResult& result);
  /// Commands it; else drops the target and returns false.
  bool command(const TargetSender& sender, const Eigen::VectorXd& pressure) {
    const auto refusal = commands_.send(sender.commander, pressure);
    if (refusal) admission_.drop(sender, *refusal);
    return !refusal;
  }

  const io::Scene& scene_;
  const std::string base_frame_;
  const model::ArmResponse& response_;
  const Commands commands_;
  statics::InverseSolver solver_;
  Eigen::VectorXd lower_, upper_;  // of effective pressures
  TargetAdmission admission_;
  control::UnitWatch units_;
  ros::Subscriber pressure_subscriber_, shape_subscriber_, tip_subscriber_;
};

}  // namespace helix_arm::ros_bridge
