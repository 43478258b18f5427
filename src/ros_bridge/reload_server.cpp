#include "helix_arm/ros_bridge/reload_server.hpp"

#include <exception>
#include <optional>
#include <stdexcept>
#include <utility>

#include <ros/console.h>

#include "helix_arm/control/quote.hpp"
#include "helix_arm/io/content_hash.hpp"
#include "helix_arm/model/requirement.hpp"
#include "helix_arm/ros_bridge/names.hpp"
#include "helix_arm/ros_bridge/parameters.hpp"

namespace helix_arm::ros_bridge {

ReloadServer::ReloadServer(ros::NodeHandle private_node, std::string path, Adopt adopt)
    : file_{path, io::sha256OfFile(path)},
      adopt_(std::move(adopt)),
      server_(private_node.advertiseService(names::kReload, &ReloadServer::onReload, this)) {}

ReloadServer::File ReloadServer::file() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return file_;
}

bool ReloadServer::onReload(Reload::Request& request, Reload::Response& response) {
  try {
    const auto path = request.scene.empty() ? std::optional(file().path)
                                            : filePath(request.scene, "config/scenes", ".yaml");
    model::require(path.has_value(), "scene is '", control::quoted(request.scene),
                   "'; expected an absolute path, or the name of a file in config/scenes of the "
                   "package");
    io::Scene scene = io::loadScene(*path);
    const File next{*path, scene.sha256};
    const std::string name = scene.name;
    adopt_(std::move(scene));
    const std::lock_guard<std::mutex> lock(mutex_);
    file_ = next;
    response.success = true;
    response.message = "scene " + name + " of " + next.path;
    ROS_INFO("reload: %s", response.message.c_str());
  } catch (const std::exception& fault) {
    response.success = false;
    response.message = fault.what();
    ROS_WARN("reload, nothing has changed: %s", response.message.c_str());
  }
  return true;
}

void requireSameRig(const io::Scene& at_hand, const io::Scene& next) {
  const model::Arm &now = at_hand.arm, &then = next.arm;
  const auto namesOf = [](const model::Arm& arm, int section) {
    std::string out;
    for (int i = arm.firstActuator(section); i < arm.firstActuator(section + 1); ++i) {
      out += (out.empty() ? "" : ", ") + arm.actuator(i).name;
    }
    return out;
  };
  const auto require = [&](bool holds, const auto&... what) {
    model::require(holds, "scene ", next.name, " is not of the rig that runs: ", what...,
                   "; end the nodes to change the rig");
  };
  require(now.sectionCount() == then.sectionCount(), "it has ", then.sectionCount(),
          " sections, expected ", now.sectionCount());
  for (int k = 0; k < now.sectionCount(); ++k) {
    require(namesOf(now, k) == namesOf(then, k), "section ", k + 1, " has the actuators ",
            namesOf(then, k), ", expected ", namesOf(now, k));
  }
  for (int i = 0; i < now.actuatorCount(); ++i) {
    require(now.actuator(i).drive == then.actuator(i).drive, now.actuator(i).name,
            " is driven otherwise");
  }
  require(at_hand.camera.has_value() == next.camera.has_value() &&
              at_hand.tags.has_value() == next.tags.has_value(),
          "only one of the two has `camera` and `tags`");
  require(at_hand.planar.has_value() == next.planar.has_value(), "its geometry is ",
          next.planar ? "planar" : "spatial", ", expected ", at_hand.planar ? "planar" : "spatial");
}

}  // namespace helix_arm::ros_bridge
