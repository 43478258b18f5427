#include <exception>
#include <memory>

#include <nodelet/nodelet.h>
#include <pluginlib/class_list_macros.hpp>

#include "helix_arm/ros_bridge/vision_node.hpp"

namespace helix_arm::ros_bridge {

/// The vision node inside a nodelet manager: pictures of a camera in the same manager come without
/// being copied.
class VisionNodelet : public nodelet::Nodelet {
 private:
  void onInit() override {
    try {
      node_ = std::make_unique<VisionNode>(getNodeHandle(), getPrivateNodeHandle());
    } catch (const NothingToDo& reason) {
      NODELET_INFO("%s", reason.what());
    }
  }

  std::unique_ptr<VisionNode> node_;
};

}  // namespace helix_arm::ros_bridge

PLUGINLIB_EXPORT_CLASS(helix_arm::ros_bridge::VisionNodelet, nodelet::Nodelet)
