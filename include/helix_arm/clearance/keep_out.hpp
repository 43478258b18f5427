#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "helix_arm/lie/se3.hpp"

namespace helix_arm::clearance {

/// Centred at the origin of its frame [m].
struct Box {
  Eigen::Vector3d size = Eigen::Vector3d::Zero();  ///< edges, > 0
};
/// About the z axis of its frame, centred at the origin [m].
struct Cylinder {
  double radius = 0.0, length = 0.0;  ///< > 0
};
/// About the origin of its frame [m].
struct Sphere {
  double radius = 0.0;  ///< > 0
};
/// All that lies below the x-y plane of its frame: z <= 0.
struct HalfSpace {};
/// A surface of triangles. What it encloses is kept out only as far as it cannot be entered.
struct Mesh {
  std::string file;
  std::vector<Eigen::Vector3d> corners;       ///< [m]
  std::vector<std::array<int, 3>> triangles;  ///< indices of corners
};
using Form = std::variant<Box, Cylinder, Sphere, HalfSpace, Mesh>;

/// A place where the arm may not be.
struct Zone {
  std::string name;
  Form form;
  lie::SE3 X_WZ;  ///< its frame, seen from the world
  /// Length of the arm, from its base, that this zone does not concern [m]: for what the arm is
  /// mounted on.
  double from = 0.0;
};

/// The body of a tool: a box, or a cylinder about its z axis.
struct ToolBody {
  std::variant<Box, Cylinder> form;
  lie::SE3 X_TB;  ///< its frame, seen from the tip
};

/// Default of KeepOut::clearance [m].
inline constexpr double kClearance = 0.01;

/// Where an arm may not be, and what of it.
struct KeepOut {
  std::vector<Zone> zones;
  double clearance = kClearance;  ///< least distance between arm and zones, >= 0 [m]
  lie::SE3 X_WB;                  ///< arm base B seen from the world
  std::vector<double> radii;      ///< (sections) of the arm about its curve, > 0 [m]
  std::optional<ToolBody> tool;   ///< in place of the last link
};

}  // namespace helix_arm::clearance
