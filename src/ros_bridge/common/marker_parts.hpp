#pragma once

#include <Eigen/Core>
#include <string>

#include <std_msgs/ColorRGBA.h>
#include <visualization_msgs/Marker.h>

#include "helix_arm/io/scene.hpp"

namespace helix_arm::ros_bridge {

std_msgs::ColorRGBA color(double r, double g, double b, double a = 1.0);

/// Makes the markers of one frame.
struct MarkerFrame {
  std::string frame;
  ros::Duration lifetime;

  /// A marker with action ADD, at the origin of the frame.
  visualization_msgs::Marker operator()(const ros::Time& stamp, const char* ns, int type,
                                        int id = 0) const;
};

/// Makes a sphere the ellipsoid of two standard deviations about its centre.
/// @param covariance  of a position, in the marker's frame [m^2].
/// @param centre      in the same frame [m].
void shapeLike(const Eigen::Matrix3d& covariance, const Eigen::Vector3d& centre,
               visualization_msgs::Marker& sphere);

/// How an arm is looked at from the side, for any mounting, and where texts about it stand, so that
/// they cover neither the arm nor each other. All vectors begin at the arm's base, in the axes of
/// the world frame, whose z axis points up, or in those of the base. Everything grows with the
/// arm's length.
///
/// A hanging or standing arm has its columns of text beside it; any other arm runs to the right,
/// with the columns above it.
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

/// Of the arm of a scene, in the axes of its base, in which it is drawn.
SideView sideViewOf(const io::Scene& scene);

/// From the centre of a line of text to that of the next, by rviz, in heights of a letter.
inline constexpr double kLineSpacing = 1.75;

/// Centre of n lines of text whose first one is at `top`.
Eigen::Vector3d centreOfLines(const SideView& view, const Eigen::Vector3d& top, int n,
                              double height);

/// Line i of a column of n lines. Each is a marker with its own colour at the column's centre;
/// empty lines before and after it keep the column aligned from every viewpoint.
std::string lineOfColumn(int i, int n, const std::string& text);

/// Lines of the legend, top to bottom. Each is drawn by whoever draws what it names.
enum class LegendLine { kModel, kTrace, kMeasured, kModelThen, kPredicted, kWanted };
inline constexpr int kLegendLineCount = 6;

/// A line of the legend as a marker of the arm's base frame.
/// @param view    in the axes of the base.
/// @param marker  text of the legend's namespace, with header and lifetime; its id becomes the
///                line's.
visualization_msgs::Marker legendLine(LegendLine line, const SideView& view,
                                      visualization_msgs::Marker marker);

}  // namespace helix_arm::ros_bridge
