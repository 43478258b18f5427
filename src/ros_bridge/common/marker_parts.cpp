#include "ros_bridge/common/marker_parts.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "ros_bridge/common/conversions.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr double kSigmas = 2.0;
constexpr double kThinnest = 1e-4;  // rviz does not draw what has no extent [m]

}  // namespace

std_msgs::ColorRGBA color(double r, double g, double b, double a) {
  std_msgs::ColorRGBA out;
  out.r = static_cast<float>(r);
  out.g = static_cast<float>(g);
  out.b = static_cast<float>(b);
  out.a = static_cast<float>(a);
  return out;
}

visualization_msgs::Marker makeMarker(const std_msgs::Header& header, const char* ns, int id,
                                      int type, const ros::Duration& lifetime) {
  visualization_msgs::Marker out;
  out.header = header;
  out.ns = ns;
  out.id = id;
  out.type = type;
  out.action = visualization_msgs::Marker::ADD;
  out.pose.orientation.w = 1.0;
  out.lifetime = lifetime;
  return out;
}

void shapeLike(const Eigen::Matrix3d& covariance, const Eigen::Vector3d& centre,
               visualization_msgs::Marker& sphere) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
  Eigen::Matrix3d axes = solver.eigenvectors();
  if (axes.determinant() < 0) axes.col(0) *= -1.0;  // right-handed
  sphere.pose = toPoseMsg({axes, centre});
  const auto diameter = [&](int axis) {
    const double sigma = std::sqrt(std::max(0.0, solver.eigenvalues()[axis]));
    return std::max(kThinnest, 2.0 * kSigmas * sigma);
  };
  sphere.scale.x = diameter(0);
  sphere.scale.y = diameter(1);
  sphere.scale.z = diameter(2);
}

}  // namespace helix_arm::ros_bridge
