#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include <ros/node_handle.h>
#include <ros/steady_timer.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/clearance/sweep.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "pressure_loop.hpp"
#include "ros_bridge/common/arm_markers.hpp"
#include "target_admission.hpp"

namespace helix_arm::ros_bridge {

/// Draws zones, in the namespace `zones`: red where the clearance is used up.
class ZoneMarkers : public Screen {
 public:
  using Screen::Screen;

  /// @param nearest  Clearance::zone. @param used_up  whether it is nearer than it may be.
  visualization_msgs::MarkerArray draw(const clearance::KeepOut& keep_out, int nearest,
                                       bool used_up, const ros::Time& stamp);

 private:
  static constexpr double kPlate = 2.0, kPlateHeight = 0.002;  ///< of a drawn half-space [m]

  void addZone(const clearance::Zone& zone, const lie::SE3& X_BZ, const std_msgs::ColorRGBA& color,
               int id);
};

/// The gate that every command of the arm passes: it is let through only if the arm stays clear of
/// the scene's zones on its whole way, from where it is to the target, at slew, with the lag of the
/// regulator and the responses of the actuators.
///
/// An arm that vision sees closer than it may be stops where it is; from then on, until it is seen
/// farther away, commands have to lead away. Vents, rests and stops pass in any case.
///
/// Without zones it does nothing. All of it belongs to the thread of the node's callback queue.
class KeepOutGate {
 public:
  /// @param scene     Kept by reference: after a change, call adopt().
  /// @param response  The arm's, as it has followed the measured pressures. Kept by reference.
  /// @param stop      Keeps the arm where it is.
  KeepOutGate(ros::NodeHandle node, const io::Scene& scene, const std::string& base_frame,
              double draw_period, const model::ArmResponse& response, std::function<void()> stop);

  /// Follows a change of the scene.
  void adopt();

  /// Why a target (n) [Pa] is not commanded; nothing if it may be.
  std::optional<control::Refusal> refusalOf(const PressureLoop& loop,
                                            const Eigen::VectorXd& target);
  /// Clearance of the last target, or where it would have been too close.
  const NearestZone& nearest() const { return nearest_; }

  /// Draws the zones; with the arm at a shape, or null where it is not known.
  void draw(const model::Shape* shape);

 private:
  static constexpr double kFreshSight = 1.0;  ///< an older one does not tell where the arm is [s]
  static constexpr double kMoved = 2e3;       ///< of a set point, while the way was checked [Pa]
  static constexpr double kCloser = 1e-3;     ///< than it was seen before [m]
  static constexpr int kMostChecks = 5;

  /// A measured shape that was too close.
  struct Sight {
    clearance::Clearance clearance;
    double nearest;  ///< since it is too close [m]
    ros::SteadyTime time;
  };
  void onMeasured(const ArmShapeConstPtr& shape);
  /// By how much the arm is nearer than its model says, while it is seen too close [m].
  double shortfall(const Eigen::VectorXd& input) const;
  std::optional<clearance::Blocked> sweep(const Eigen::VectorXd& set_point,
                                          const Eigen::VectorXd& reading,
                                          const Eigen::VectorXd& target) const;
  control::Refusal refuse(const clearance::Blocked& blocked);

  const io::Scene& scene_;
  const std::string base_frame_;
  const model::ArmResponse& response_;
  const std::function<void()> stop_;
  std::optional<clearance::SweepCheck> check_;  ///< absent without zones
  NearestZone nearest_;
  std::optional<Sight> close_;  ///< the last sight, if it was too close
  FaultCount close_sights_, bad_shapes_;
  ros::NodeHandle node_;
  ZoneMarkers markers_;
  ros::Publisher marker_publisher_;
  ros::Subscriber measured_;
};

}  // namespace helix_arm::ros_bridge
