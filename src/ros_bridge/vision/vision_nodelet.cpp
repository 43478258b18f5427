
#include <nodelet/nodelet.h>
#include <pluginlib/class_list_macros.hpp>

#include "ros_bridge/common/run_node.hpp"

namespace helix_arm::ros_bridge {

/// The vision node as a nodelet: pictures of a camera in the same manager are not copied.
class VisionNodelet : public nodelet::Nodelet {
 private:
  void onInit() override {
    const int code = guarded([this]() -> int {
      node_ = makeVisionInManager(getNodeHandle(), getPrivateNodeHandle());
      return kDone;
    });
    if (code == kDone) return;
    // The manager does not print the message of the exception.
    NODELET_FATAL("%s is not loaded: see the faults above", getName().c_str());
    throw std::runtime_error(getName() + " has faults that were printed");
  }

  std::unique_ptr<Node> node_;
};

}  // namespace helix_arm::ros_bridge

PLUGINLIB_EXPORT_CLASS(helix_arm::ros_bridge::VisionNodelet, nodelet::Nodelet)
