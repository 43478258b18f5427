#pragma once

#include <memory>
#include <string>

#include <actionlib/server/simple_action_server.h>
#include <ros/node_handle.h>

#include "basics/mutex.hpp"
#include "helix_arm/PlanTipPathAction.h"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/planning/pressure_planner.hpp"
#include "pressure_loop.hpp"
#include "ros_bridge/common/diagnostics.hpp"

namespace helix_arm::ros_bridge {

/// Serves a node's `~plan_tip_path`: ways around the zones of its scene, one search at a time in a
/// thread of its own. A new goal ends the search before it.
class PlanServer {
 public:
  /// @param loop  Whose command a search begins at. Outlives this.
  PlanServer(const ros::NodeHandle& private_node, const io::Scene& scene,
             const std::string& base_frame, const PressureLoop& loop);
  /// Ends a search.
  ~PlanServer();

  /// From now on of this scene; a running search ends with the one before.
  void adopt(const io::Scene& scene) HELIX_ARM_EXCLUDES(mutex_);

 private:
  using Server = actionlib::SimpleActionServer<PlanTipPathAction>;

  /// Parts of a scene that a search needs.
  struct Rig {
    statics::ArmModel model;
    planning::PressurePlanner planner;
  };

  void onGoal(const PlanTipPathGoal& goal);
  PlanTipPathResult plan(const PlanTipPathGoal& goal);
  planning::Plan search(const Rig& rig, const PlanTipPathGoal& goal);

  const std::string base_frame_;
  const PressureLoop& loop_;
  basics::Mutex mutex_;
  std::shared_ptr<const Rig> rig_ HELIX_ARM_GUARDED_BY(mutex_);  ///< null without zones
  double told_ = 0.0;  ///< last feedback; touched by the thread that searches alone [s]
  FaultGuard guard_{"a goal of plan_tip_path"};
  Server server_;
};

}  // namespace helix_arm::ros_bridge
