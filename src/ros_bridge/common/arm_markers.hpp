#pragma once

#include <Eigen/Core>
#include <deque>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <interactive_markers/interactive_marker_server.h>
#include <ros/time.h>
#include <std_msgs/ColorRGBA.h>
#include <visualization_msgs/MarkerArray.h>

#include "helix_arm/TipTarget.h"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/localization/twist_fit.hpp"
#include "helix_arm/model/curve.hpp"
#include "ros_bridge/common/diagnostics.hpp"

/// Display of an arm in rviz: markers in its base frame, in stable namespaces and ids; its handle.
namespace helix_arm::ros_bridge {

std_msgs::ColorRGBA color(double r, double g, double b, double a = 1.0);

/// How an arm is looked at from the side, for any mounting, and where texts about it stand, so that
/// they cover neither the arm nor each other. All vectors begin at the arm's base, in the axes of
/// the world frame, whose z axis points up, or of the base; all grows with the arm's length.
///
/// A hanging or standing arm has its columns of text beside it; any other runs right, below them.
struct SideView {
  double scale = 1.0;                     ///< of texts: 1 for an arm of 0.3 m
  double yaw = 0.0, pitch = 0.0;          ///< of a camera that orbits as rviz/Orbit does [rad]
  Eigen::Vector3d right, up;              ///< of the picture
  Eigen::Vector3d beyond;                 ///< from the tip to where its texts stand free of the arm
  Eigen::Vector3d headline;               ///< centre of the state [m]
  Eigen::Vector3d legend_top, table_top;  ///< centres of the first lines of the columns [m]
  Eigen::Vector3d centre;                 ///< of arm and texts [m]
  double width = 0.0, height = 0.0;       ///< of arm and texts in the picture [m]

  /// Distance from which all is in view.
  /// @param field_of_view  from bottom to top [rad]. @param aspect  width by height of the picture.
  double distance(double field_of_view, double aspect) const;
};

/// In the axes of the world frame.
/// @param axis    in which the arm leaves its base, world frame.
/// @param length  of the arm, > 0 [m].
/// @param radius  of its discs [m].
SideView sideView(const Eigen::Vector3d& axis, double length, double radius);

/// The same in the axes of the base, except for yaw and pitch.
/// @param view  in the axes of the world frame.
SideView seenFrom(const Eigen::Matrix3d& R_WB, SideView view);

/// Side view of the arm of a scene, in the axes of its base, in which it is drawn.
SideView sideViewOf(const io::Scene& scene);

/// From the centre of a line of text to that of the next, by rviz, in heights of a letter.
inline constexpr double kLineSpacing = 1.75;

/// Lines of whole words; each fits, unless a word does not.
std::vector<std::string> wrapped(const std::string& text,
                                 const std::function<bool(const std::string& line)>& fits);

/// The markers of one drawing after the other. What was drawn once and is not drawn now is deleted,
/// with each drawing, since rviz may miss one.
class Screen {
 public:
  /// @param period  of drawing [s].
  Screen(std::string frame, double period);

  /// Takes everything off the screen.
  visualization_msgs::MarkerArray remove(const ros::Time& stamp) {
    begin(stamp);
    return end();
  }

 protected:
  using Marker = visualization_msgs::Marker;

  /// Lines of the legend, top to bottom. Each is drawn by whoever draws what it names.
  enum Legend { kModel, kTrace, kMeasured, kModelThen, kPredicted, kWanted };

  /// Begins a drawing. @return whether its stamp is before the last one: a jump back in time.
  bool begin(const ros::Time& stamp) { return stamp < std::exchange(stamp_, stamp); }

  // The markers of a drawing. Each result is valid until the next one.

  /// At the origin of the frame.
  Marker& add(const char* ns, int type, const std_msgs::ColorRGBA& color, int id = 0);
  /// @param centre  of all lines [m]. @param height  of a letter [m].
  Marker& addText(const char* ns, const Eigen::Vector3d& centre, double height,
                  const std_msgs::ColorRGBA& color, const std::string& text, int id = 0);
  /// A line of this type through points.
  Marker& addLine(const char* ns, int type, double width, const std_msgs::ColorRGBA& color,
                  const std::vector<Eigen::Vector3d>& points);
  /// A sphere.
  Marker& addBall(const char* ns, const Eigen::Vector3d& centre, double size,
                  const std_msgs::ColorRGBA& color);
  /// The ellipsoid of two standard deviations about a centre.
  void addEllipsoid(const char* ns, const Eigen::Vector3d& centre,
                    const Eigen::Matrix3d& covariance, const std_msgs::ColorRGBA& color);
  /// @return its colour, for what it names.
  std_msgs::ColorRGBA addLegend(Legend line, const SideView& view, double opacity = 1.0);

  /// Ends a drawing.
  visualization_msgs::MarkerArray end();

 private:
  using Key = std::pair<std::string, int>;  ///< namespace and id

  const std::string frame_;
  const ros::Duration lifetime_;
  ros::Time stamp_;
  visualization_msgs::MarkerArray drawing_;
  std::set<Key> known_;  ///< drawn once
};

/// Draws an arm.
///
/// - muscles: a tube per actuator, from blue (lower limit of its pressure) to lilac (upper limit)
/// - base_curve: the curve that the muscles bend
/// - separators: the discs that hold the muscles
/// - tip_trace: trace of the tip, smoothed over a few drawings
/// - pressures: one line of text per actuator, in kPa and in its muscle's colour, beside the base
/// - state_banner: the arm's state (0), after its name if frames have a prefix, and its reason (1)
/// - legend: what is drawn here, one line each in its curve's colour
class ArmMarkers : public Screen {
 public:
  /// Keeps a reference to the scene.
  ArmMarkers(const io::Scene& scene, const std::string& base_frame, double period);

  /// The text above the base, with the next drawing.
  void tell(const control::SafetyReport& report, const std::string& reason) {
    safety_ = report;
    reason_ = reason;
  }

  /// @param pressure  (n) pressures for the colours and the text, gauge [Pa].
  /// @param stamp     of the shape; a jump back in time starts a new trace.
  visualization_msgs::MarkerArray draw(const model::Shape& shape, const model::InputRef& pressure,
                                       const ros::Time& stamp);

  /// Removes all markers; the next drawing starts a new trace.
  visualization_msgs::MarkerArray remove(const ros::Time& stamp) {
    trace_.clear();
    return Screen::remove(stamp);
  }

 private:
  using Curve = std::vector<model::CurvePoint<lie::SE3>>;

  void addMuscles(const Curve& curve, const lie::SE3& X_end, int section,
                  const model::InputRef& pressure, const SideView& view);
  /// @param disc  id of the next disc.
  void addDiscs(const model::Shape& shape, const lie::SE3& X_end, int section, int& disc);
  void extendTrace(const Eigen::Vector3d& tip);
  void addWords(const SideView& view);

  const io::Scene& scene_;
  const std::string arm_;  ///< name of the arm, with a colon
  control::SafetyReport safety_;
  std::string reason_;
  Eigen::Vector3d smooth_tip_;         ///< base frame [m]
  std::deque<Eigen::Vector3d> trace_;  ///< base frame [m]
};

/// Draws what is measured.
///
/// - measured_curve: solid
/// - model_curve: dashed
/// - tags: outlines of those that the shape was fitted to, red where they do not fit
/// - tip_error: what the tip's distance from the model is, as text beyond the tip
/// - legend: what the curves are, one line each in its curve's colour
/// - tip_covariance: where the tip is within two standard deviations, an ellipsoid
class VisionMarkers : public Screen {
 public:
  using Screen::Screen;

  /// @param view   in the axes of the base.
  /// @param fit    a measured shape.
  /// @param model  that it is compared with; null: none is drawn.
  /// @param text   beyond the tip.
  visualization_msgs::MarkerArray draw(const ros::Time& stamp, const SideView& view,
                                       const estimation::TagLayout& layout,
                                       const estimation::TwistFit& fit, const model::Shape* model,
                                       const std::string& text);

 private:
  void addOutlines(const estimation::TagLayout& layout, const estimation::TwistFit& fit);
};

/// Draws what a loop over vision wants and predicts.
///
/// - wanted_tip: a ball at the wanted tip
/// - predicted_tip: a ball at the tip of the corrected model, and predicted_curve its curve
/// - predicted_covariance: where that tip is within two standard deviations, an ellipsoid
/// - tip_force: an arrow to the predicted tip along the force that touches the arm
/// - loop_state: the loop's state and error, as text below the predicted tip
/// - legend: what is drawn here, one line each in its colour
/// - error_budget: standard deviations of the tip by their sources, as a table beside the ellipsoid
class LoopMarkers : public Screen {
 public:
  /// The tips at one time, base frame. What is absent is not drawn.
  struct Tips {
    std::optional<Eigen::Vector3d> wanted;                 ///< [m]
    std::optional<Eigen::Vector3d> predicted;              ///< [m]
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< of predicted [m^2]
    std::optional<Eigen::Vector3d> force;  ///< on the arm, while something touches it [N]
    std::vector<Eigen::Vector3d> curve;    ///< of the corrected model; empty if unknown
    std::string text;
    std::string budget;    ///< the table; empty: none
    bool outside = false;  ///< the budget does not explain what is measured
  };

  using Screen::Screen;

  /// @param view  in the axes of the base.
  visualization_msgs::MarkerArray draw(const ros::Time& stamp, const SideView& view,
                                       const Tips& tips);
};

/// A handle in rviz that drags the tip: an interactive marker that sends targets of the position.
class TipHandle {
 public:
  using OnTarget = std::function<void(const TipTarget&)>;

  /// @param scene      of the arm: tip and handle of a planar one stay in the base's x-y plane.
  /// @param on_target  called from the callback queue while it is held, with a target in its frame.
  TipHandle(const std::string& base_frame, const io::Scene& scene, OnTarget on_target);

  /// Moves the handle to the commanded tip (base frame), unless it is held.
  void follow(const lie::SE3& X_BT);

 private:
  void onFeedback(const visualization_msgs::InteractiveMarkerFeedbackConstPtr& feedback);
  bool held() const;

  FaultGuard guard_{"a feedback of the tip's handle"};
  OnTarget on_target_;
  interactive_markers::InteractiveMarkerServer server_;
  Eigen::Vector3d position_ = Eigen::Vector3d::Constant(1e9);  ///< of the handle, base frame [m]
  bool pressed_ = false;
  ros::SteadyTime last_feedback_;
};

}  // namespace helix_arm::ros_bridge
