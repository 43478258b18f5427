#include "reload_server.hpp"

#include <exception>

#include "file_access.hpp"
#include "guarded_callbacks.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/shipped_files.hpp"
#include "log.hpp"
#include "parameters.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

using io::kShippedScenes;

ReloadServer::ReloadServer(ros::NodeHandle private_node, std::string path, std::string scene_folder,
                           Adopt adopt)
    : first_path_(path),
      scene_folder_(std::move(scene_folder)),
      file_{path, io::sha256OfFile(path)},
      adopt_(std::move(adopt)),
      server_(serve(private_node, names::kReload, &ReloadServer::onReload, this)) {}

ReloadServer::File ReloadServer::file() const {
  const basics::MutexLock lock(mutex_);
  return file_;
}

std::string ReloadServer::allowed(const std::string& scene) const {
  if (scene.empty()) return file().path;
  if (scene == first_path_) return scene;
  const auto path = filePath(scene, io::kShippedScenes, ".yaml");
  basics::require(path.has_value(), "scene is '", basics::quoted(scene),
                  "'; expected an absolute path, or the name of a file in ", io::kShippedScenes,
                  " of the package");
  if (scene.front() != '/') return *path;
  const FileAccess access({{scene_folder_, "~scene_folder"},
                           {io::shippedFolder(io::kShippedScenes), "the package's own"}});
  return access.toRead("scene", *path, {".yaml"});
}

bool ReloadServer::onReload(Reload::Request& request, Reload::Response& response) {
  try {
    const std::string path = allowed(request.scene);
    io::Scene scene = io::loadScene(path);
    File next{path, scene.sha256};
    const std::string name = scene.name;
    {
      const basics::MutexLock lock(mutex_);
      adopt_(std::move(scene));
      file_ = std::move(next);
    }
    response.success = true;
    response.message = "scene " + name + " of " + path;
    logInfo("reload: %s", response.message.c_str());
  } catch (const std::exception& fault) {
    response.success = false;
    response.message = basics::printableLines(fault.what());
    logWarning("reload refused, nothing changed: %s", response.message.c_str());
  }
  return true;
}

}  // namespace helix_arm::ros_bridge
