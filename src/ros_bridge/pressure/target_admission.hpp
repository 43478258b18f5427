#pragma once

#include <optional>
#include <string>
#include <utility>
#include <variant>

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/node_handle.h>
#include <ros/time.h>

#include "helix_arm/TargetStatus.h"
#include "helix_arm/control/commander_lease.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "ros_bridge/pressure/target_ledger.hpp"

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
  diagnostic_msgs::DiagnosticStatus status(const std::string& node);

 private:
  std::optional<control::Refusal> ageRefusal(const TargetSender& sender) const;

  const io::Scene& scene_;
  control::CommanderLease lease_;
  TargetLedger ledger_;
  ros::Publisher publisher_;
};

/// The refusal of a target for which the inverse finds no pressures.
control::Refusal notConverged();

}  // namespace helix_arm::ros_bridge
