#pragma once

#include <deque>
#include <string>
#include <utility>
#include <vector>

#include <visualization_msgs/MarkerArray.h>

#include "helix_arm/control/safety.hpp"
#include "helix_arm/io/scene.hpp"
#include "ros_bridge/common/side_view.hpp"

namespace helix_arm::ros_bridge {

/// Draws an arm for rviz, seen from its base frame, in stable namespaces and ids.
///
/// - muscles: one tube per actuator, coloured by its pressure: blue at the lower limit, lilac at
/// the
///   upper one
/// - base_curve: the curve that the muscles bend
/// - separators: the discs that hold the muscles
/// - tip_trace: trace of the tip, smoothed over a few drawings
/// - pressures: one line of text per actuator, in kPa and in its muscle's colour, beside the base
/// - state_banner: the state of the arm (0), after its name if its frames have a prefix, and its
///   reason (1), in the state's colour
/// - legend: what is drawn here, one line each in its curve's colour
class ArmMarkers {
 public:
  /// Keeps a reference to the scene.
  ///
  /// @param lifetime  longer than the period of drawing [s].
  ArmMarkers(const io::Scene& scene, std::string base_frame, double lifetime);

  /// The text above the base, with the next drawing.
  void tell(const control::SafetyReport& report, const std::string& reason);

  /// @param shape     to draw.
  /// @param pressure  (n) pressures for the colours and the text, gauge [Pa].
  /// @param stamp     stamp of the shape; one before the last stamp (a jump back in time) starts a
  /// new trace.
  visualization_msgs::MarkerArray draw(const model::Shape& shape, const model::InputRef& pressure,
                                       const ros::Time& stamp);

  /// Removes all markers; the next drawing starts a new trace.
  visualization_msgs::MarkerArray remove(const ros::Time& stamp);

 private:
  visualization_msgs::Marker marker(const char* ns, int id, int type) const;
  void extendTrace(const Eigen::Vector3d& tip);
  void addWords(const SideView& view, visualization_msgs::MarkerArray& out) const;

  const io::Scene& scene_;
  std::string base_frame_;
  ros::Duration lifetime_;
  ros::Time stamp_;
  control::SafetyReport safety_;
  std::string reason_;
  std::vector<std::pair<std::string, int>> drawn_;  ///< namespaces and ids on the screen
  Eigen::Vector3d smooth_tip_;                      ///< base frame [m]
  std::deque<Eigen::Vector3d> trace_;               ///< base frame [m]
};

}  // namespace helix_arm::ros_bridge
