#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/clearance/arm_clearance.hpp"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/statics/arm_model.hpp"

namespace helix_arm::clearance {

/// Where a motion would come too close.
struct Blocked {
  std::string zone;            ///< that is too near; empty if no shape balances the load there
  double clearance = 0.0;      ///< distance from it there [m]
  double least = 0.0;          ///< that is asked for [m]
  Eigen::VectorXd input;       ///< (n) there
  Eigen::VectorXd last_clear;  ///< (n) of the last place before; empty if there is none
  Eigen::Vector3d clear_tip = Eigen::Vector3d::Zero();  ///< of last_clear, base frame [m]

  /// "comes within 3.1 mm of post; clearance_m asks for 10 mm".
  std::string text() const;
};

/// A sweep is divided until its places move less than this between two looks [m]. Between them, the
/// arm may be half as much closer than it may.
inline constexpr double kFinestMotion = 2e-4;

/// Motions of an arm through the shapes of its model, among zones.
///
/// Between two shapes no place of the body is farther from both than what it moves, so that a
/// motion is clear where both are far enough away, and otherwise divided. An arm that is too close
/// may move as long as it does not come closer, and ends farther away.
///
/// Immutable; threads may share it.
class SweepCheck {
 public:
  /// @throws std::invalid_argument as ArmClearance.
  SweepCheck(const statics::ArmModel& model, const KeepOut& keep_out);

  const ArmClearance& clearance() const { return clearance_; }
  /// Clearance at inputs q (n); none where no shape balances the load.
  /// @throws as ArmModel::solve().
  std::optional<Clearance> at(const model::InputRef& q) const;
  /// Whether the arm is clear at inputs q (n). @throws likewise.
  bool isClear(const model::InputRef& q) const;

  /// The first place at which a motion is too close; none if all of it is clear.
  /// @param corners  (n) inputs that are joined by straight lines; at least one.
  /// @param nearer   by how much the arm is closer to the zones than its model says, >= 0 [m].
  std::optional<Blocked> sweep(const std::vector<Eigen::VectorXd>& corners,
                               double nearer = 0.0) const;

 private:
  struct Look;
  class Walk;
  Look look(const Eigen::VectorXd& q) const;

  statics::ArmModel model_;
  ArmClearance clearance_;
  double longest_;  // motion between two looks [m]
};

/// Pressures on the way of a command: set points go to it at their slew, and each pressure follows
/// its set point with the lag of the rules.
///
/// @param set_point, pressure  (n) at the beginning [Pa]. @param target  (n) [Pa].
/// @return corners, from `pressure` to `target`.
std::vector<Eigen::VectorXd> pressuresOnTheWay(const std::vector<control::ChannelRules>& channels,
                                               const control::SafetyRules& rules,
                                               const Eigen::VectorXd& set_point,
                                               const Eigen::VectorXd& pressure,
                                               const Eigen::VectorXd& target);

/// Pressures behind set points (n) [Pa] that follow each other every so often [s], at an even rate
/// between them.
///
/// @return corners, from the first set points to the last.
std::vector<Eigen::VectorXd> pressuresBehind(const std::vector<control::ChannelRules>& channels,
                                             const control::SafetyRules& rules, double every,
                                             const std::vector<Eigen::VectorXd>& set_points);

}  // namespace helix_arm::clearance
