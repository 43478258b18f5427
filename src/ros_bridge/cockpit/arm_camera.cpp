#include "arm_camera.hpp"

#include "ros_bridge/common/arm_markers.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr double kFieldOfView = 0.785;  // of rviz, from bottom to top [rad]
constexpr double kDiscRadius = 0.1;     // of an arm's discs, in its lengths

}  // namespace

bool isToChange(const ArmCamera& camera, const std::string& base_frame) {
  if (camera.target == base_frame) return camera.focus.isZero(0);
  return camera.target == names::kBaseFrame;
}

ArmCamera changed(ArmCamera camera, const std::string& base_frame, const Eigen::Vector3d& axis,
                  double length, double aspect) {
  camera.target = base_frame;
  if (!camera.focus.isZero(0)) return camera;
  const SideView side = sideView(axis, length, kDiscRadius * length);
  camera.focus = side.centre;
  camera.yaw = side.yaw;
  camera.pitch = side.pitch;
  camera.distance = side.distance(kFieldOfView, aspect);
  return camera;
}

}  // namespace helix_arm::ros_bridge
