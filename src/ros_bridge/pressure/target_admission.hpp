#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/message_event.h>
#include <ros/node_handle.h>

#include "helix_arm/TargetStatus.h"
#include "helix_arm/TipTarget.h"
#include "helix_arm/control/commander_lease.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "ros_bridge/common/diagnostics.hpp"

namespace helix_arm::ros_bridge {

/// When a target counts as reached: at rest. While the arm creeps, its pressures do not change.
inline constexpr model::AfterMove kTargetAt = model::AfterMove::kAtRest;

/// Who sent which target.
struct TargetSender {
  std::string topic;
  std::string commander;
  ros::Time stamp;
  bool ages = true;  ///< its stamp tells how old it is; not that of the interactive marker

  template <class Message>
  TargetSender(const char* on, const ros::MessageEvent<const Message>& event)
      : topic(on), commander(event.getPublisherName()), stamp(event.getMessage()->header.stamp) {}
  /// Sender of the interactive marker.
  explicit TargetSender(const ros::Time& time);
};

/// Solution of the inverse for a target.
struct TargetSolution {
  statics::InverseStatus status;
  double residual;                            ///< norm of the weighted error [m]
  double position_error;                      ///< distance from the commanded tip to the target [m]
  const std::vector<statics::Limit>& limits;  ///< (n)
};

/// The zone that the arm is nearest to, or would come too close to.
struct NearestZone {
  double clearance = std::numeric_limits<double>::infinity();  ///< [m]
  std::string zone;                                            ///< empty: none
  std::optional<Eigen::Vector3d> clear_tip;  ///< if a target is blocked, the last one before [m]
};

/// Hears the targets of tip and shape, decides whose targets are taken, by their stamps and a
/// lease, and publishes target_status: one answer per target. Counts them, and warns of those that
/// are dropped or out of reach.
class TargetAdmission {
 public:
  /// Takes a target of tip_target or tip_target_pose.
  using AimTip = std::function<void(const TargetSender& sender, const TipTarget& target)>;
  /// Takes an admitted target of shape_target.
  using AimShape = std::function<void(const TargetSender& sender, const model::Twists& twists)>;

  /// @param scene  Kept by reference: after a change, call adopt() before the next target.
  TargetAdmission(ros::NodeHandle& node, const io::Scene& scene, AimTip aim_tip,
                  const AimShape& aim_shape);

  /// A target from the interactive marker, whose stamp is not checked.
  void takeFromHandle(const TipTarget& target) {
    aim_tip_(TargetSender(target.header.stamp), target);
  }

  /// Follows a change of the scene. Whoever holds the lease keeps it.
  void adopt();

  /// The target's value if it is sound and fresh and its sender may command; else drops it: null.
  template <class T>
  const T* admit(const TargetSender& sender, const control::Checked<T>& checked) {
    if (const auto other = refusalOf(sender, std::get_if<control::Refusal>(&checked))) {
      drop(sender, *other);
      return nullptr;
    }
    return &std::get<T>(checked);
  }

  /// Grants or renews the lease of a commander, or says who holds it.
  std::optional<control::Refusal> claim(const std::string& commander);

  /// Told in the answers from now on.
  void tell(const NearestZone& nearest) { nearest_ = nearest; }

  void drop(const TargetSender& sender, const control::Refusal& refusal);
  /// Answers a target that the command realises.
  void accept(const TargetSender& sender);
  /// Answers a target by its inverse: reached, replaced by the closest, or dropped if it has none.
  void accept(const TargetSender& sender, const TargetSolution& solution);

  /// The status `<node>: targets`: WARN if one was dropped or out of reach since the last call.
  diagnostic_msgs::DiagnosticStatus status();

 private:
  TargetStatus answerTo(const TargetSender& sender) const;
  std::optional<control::Refusal> refusalOf(const TargetSender& sender,
                                            const control::Refusal* of_value);
  /// At most one line per fault and period.
  void warn(FaultCount& count, const TargetSender& sender, const std::string& message,
            const char* consequence);

  const io::Scene& scene_;
  const AimTip aim_tip_;
  control::CommanderLease lease_;
  std::uint64_t reached_ = 0;
  FaultCount unreachable_;
  std::array<FaultCount, control::kFaultCount> dropped_;
  std::string last_fault_;
  NearestZone nearest_;
  bool news_ = false;  ///< a target was dropped or out of reach since the last status
  ros::Publisher publisher_;
  ros::Subscriber tip_subscriber_, pose_subscriber_, shape_subscriber_;
};

}  // namespace helix_arm::ros_bridge
