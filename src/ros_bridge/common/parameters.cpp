#include "parameters.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <sstream>
#include <system_error>

#include "basics/quote.hpp"
#include "basics/text.hpp"
#include "guarded_callbacks.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "io/scene/shipped_files.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

namespace fs = std::filesystem;
using basics::messageOf;

constexpr std::size_t kLongestPath = 300;  // in a message

bool isBelow(const fs::path& path, const fs::path& folder) {
  const auto [of_folder, of_path] =
      std::mismatch(folder.begin(), folder.end(), path.begin(), path.end());
  return !folder.empty() && of_folder == folder.end() && of_path != path.end();
}

// Absolute path of a file, or of the one that the package ships in `folder` under this bare name;
// nothing if the text is neither.
std::optional<std::string> filePath(const std::string& given, const std::string& folder,
                                    const std::string& extension) {
  if (given.empty()) return std::nullopt;
  if (given.front() == '/') return given;
  if (io::isPath(given)) return std::nullopt;
  return messageOf(io::shippedFolder(folder), "/", given, extension);
}

}  // namespace

std::string defaultFolder() {
  const char* const ros_home = std::getenv("ROS_HOME");
  if (ros_home != nullptr && *ros_home != '\0') return std::string(ros_home) + "/helix_arm";
  const char* const home = std::getenv("HOME");
  return std::string(home != nullptr ? home : "") + "/.ros/helix_arm";
}

std::string sceneBelow(const std::vector<SceneFolder>& folders, const std::string& given) {
  std::string below;
  for (const SceneFolder& folder : folders) {
    below += (below.empty() ? " below " : " or ") + folder.path + " (" + folder.parameter + ")";
  }
  const std::string quoted = basics::quoted(given, kLongestPath);
  const auto require = [&](bool holds) {
    basics::require(holds, "scene is '", quoted, "'; expected the absolute path of a .yaml file",
                    below);
  };
  // The system would cut a path at a null character, and messages repeat it.
  require(!given.empty() && given.front() == '/' && basics::printable(given) == given);
  std::error_code fault;
  const fs::path path = fs::weakly_canonical(given, fault);
  require(!fault);
  require(std::any_of(folders.begin(), folders.end(), [&](const SceneFolder& folder) {
    // Empty if the folder cannot be reached; no path is below that.
    std::error_code unreachable;
    return isBelow(path, fs::weakly_canonical(folder.path, unreachable));
  }));
  require(path.extension() == ".yaml");
  std::error_code ignored;
  basics::require(fs::is_regular_file(path, ignored), "scene is '", quoted,
                  "', which is not a regular file");
  return path.string();
}

LoopWatch::LoopWatch(ros::NodeHandle& node)
    : subscriber_(listen(node, names::kVisualServoStatus, 10, &LoopWatch::onStatus, this)) {}

void LoopWatch::requireFree() const {
  constexpr double kFresh = 1.0;  // [s]
  basics::require(
      commanded_.isZero() || ros::SteadyTime::now() - commanded_ > ros::WallDuration(kFresh),
      "visual_servo commands the arm, and all nodes take one scene; cancel its goal, or send it no "
      "target, and reload visual_servo first");
}

void LoopWatch::onStatus(const LoopStatusConstPtr& status) {
  // A hold has no time on a path.
  const bool commands = status->has_wanted && (status->commander != names::kFollowTipPath ||
                                               std::isfinite(status->path_time));
  commanded_ = commands ? ros::SteadyTime::now() : ros::SteadyTime();
}

ReloadServer::ReloadServer(ros::NodeHandle private_node, std::string path, std::string scene_folder,
                           Adopt adopt)
    : first_path_(path),
      scene_folder_(std::move(scene_folder)),
      path_(std::move(path)),
      adopt_(std::move(adopt)),
      server_(serve(private_node, names::kReload, &ReloadServer::onReload, this)) {}

std::string ReloadServer::allowed(const std::string& scene) const {
  if (scene.empty()) return path_;
  if (scene == first_path_) return scene;
  const auto path = filePath(scene, io::kShippedScenes, ".yaml");
  basics::require(path.has_value(), "scene is '", basics::quoted(scene),
                  "'; expected an absolute path, or the name of a file in ", io::kShippedScenes,
                  " of the package");
  if (scene.front() != '/') return *path;
  return sceneBelow({{scene_folder_, "~scene_folder"},
                     {io::shippedFolder(io::kShippedScenes), "the package's own"}},
                    *path);
}

bool ReloadServer::onReload(const Reload::Request& request, Reload::Response& response) {
  try {
    const std::string path = allowed(request.scene);
    io::Scene scene = io::loadScene(path);
    const std::string name = scene.name;
    adopt_(std::move(scene));
    path_ = path;
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

void ParameterReader::fault(const std::string& name, const Value& value, const std::string& rule) {
  std::ostringstream given;
  if (value.valid()) ::operator<<(given << "is ", value);  // those of messages hide it
  faults_.push_back(
      messageOf("~", name, " ", value.valid() ? given.str() : "is missing", "; expected ", rule));
}

template <class T>
T ParameterReader::value(const std::string& name, const T& fallback, const std::string& rule,
                         const std::function<std::optional<T>(XmlRpc::XmlRpcValue&)>& take) {
  known_.insert(node_.resolveName(name));
  XmlRpc::XmlRpcValue given;
  if (!node_.getParam(name, given) || !given.valid()) return fallback;
  if (const std::optional<T> taken = take(given)) return *taken;
  fault(name, given, rule);
  return fallback;
}

std::string ParameterReader::text(const std::string& name, const std::string& fallback) {
  return value<std::string>(name, fallback, "text", [](Value& given) {
    return given.getType() == Value::TypeString ? std::optional(static_cast<std::string&>(given))
                                                : std::nullopt;
  });
}

std::string ParameterReader::frame(const std::string& name, const std::string& fallback) {
  std::string given = text(name, fallback);
  const bool empty = given.empty() && !fallback.empty();
  if (!empty && given.compare(0, 1, "/") != 0) return given;
  fault(name, Value(given), "a tf2 frame: not empty, no leading slash");
  return fallback;
}

std::string ParameterReader::choice(const std::string& name, const std::string& fallback,
                                    const std::vector<std::string>& words) {
  std::string given = text(name, fallback);
  if (std::find(words.begin(), words.end(), given) != words.end()) return given;
  fault(name, Value(given), basics::joined(words, " or "));
  return fallback;
}

bool ParameterReader::flag(const std::string& name, bool fallback) {
  return value<bool>(name, fallback, "true or false", [](Value& given) {
    return given.getType() == Value::TypeBoolean ? std::optional(static_cast<bool&>(given))
                                                 : std::nullopt;
  });
}

double ParameterReader::number(const std::string& name, double fallback,
                               const model::Range& allowed) {
  const std::string rule = messageOf("a number from ", allowed.lower, " to ", allowed.upper);
  return value<double>(name, fallback, rule, [&allowed](Value& given) {
    double number = std::nan("");
    if (given.getType() == Value::TypeInt) number = static_cast<int&>(given);
    if (given.getType() == Value::TypeDouble) number = static_cast<double&>(given);
    return allowed.contains(number) ? std::optional(number) : std::nullopt;
  });
}

int ParameterReader::count(const std::string& name, int fallback, int lower, int upper) {
  const std::string rule = messageOf("a whole number from ", lower, " to ", upper);
  return value<int>(name, fallback, rule, [lower, upper](Value& given) -> std::optional<int> {
    if (given.getType() != Value::TypeInt) return std::nullopt;
    const int number = static_cast<int&>(given);
    return number >= lower && number <= upper ? std::optional(number) : std::nullopt;
  });
}

std::string ParameterReader::file(const std::string& name, const std::string& folder,
                                  const std::string& extension) {
  const std::size_t before = faults_.size();
  const std::string given = text(name, "");
  if (given.empty()) {
    if (faults_.size() == before) {
      fault(name, Value(),
            messageOf("a path, or the name of a file in ", folder, " of the package"));
    }
    return "";
  }
  if (io::isPath(given)) {
    const auto meant = io::shippedNameOf(given, folder, extension);
    if (!meant) return absolute(name, given);
    fault(name, Value(given), "a file that is there, or " + *meant + ", which is shipped");
    return "";
  }
  std::string path = *filePath(given, folder, extension);
  if (std::filesystem::exists(path)) return path;
  const std::string names = basics::joined(io::shippedNames(folder, extension));
  fault(name, Value(given),
        messageOf("a path, or the name of a file in ", folder, " of the package: ", names));
  return "";
}

std::string ParameterReader::absolute(const std::string& name, const std::string& given) {
  const fs::path path = fs::absolute(given);
  std::error_code ignored;
  if (path != given && !fs::exists(path, ignored)) {
    fault(name, Value(path.string()),
          messageOf("what is there; ", given, " was taken from the working directory of the node, ",
                    "which is ~/.ros with roslaunch: give an absolute path, such as $PWD/", given));
  }
  return path.string();
}

void ParameterReader::finish() {
  std::vector<std::string> set;
  node_.getParamNames(set);
  const std::string mine = node_.getNamespace() + "/";
  for (const std::string& name : set) {
    if (name.compare(0, mine.size(), mine) == 0 && known_.count(name) == 0) {
      logWarning("the node does not know the parameter %s; check its spelling",
                 basics::printable(name).c_str());
    }
  }
  if (faults_.empty()) return;
  for (std::string& line : faults_) line = basics::printable(line);
  throw std::invalid_argument(basics::joined(faults_, "\n"));
}

io::Scene requirePneumatic(io::Scene scene) {
  std::string faults;
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    const model::Actuator& actuator = scene.arm.actuator(i);
    if (model::isPressure(actuator.drive)) continue;
    faults += "\n" + actuator.name + " is a tendon; expected muscles and bellows only";
  }
  basics::require(faults.empty(), "scene ", scene.name, " cannot be driven by pressure:", faults);
  return scene;
}

const regulator::Config& requireRegulator(const io::Scene& scene) {
  basics::require(scene.regulator.has_value(), "scene ", scene.name,
                  " has no regulator; add the section `regulator` to it");
  return *scene.regulator;
}

void warnOfShortSupply(const io::Scene& scene) {
  const auto* const config = std::get_if<regulator::SimulatedRegulatorConfig>(&*scene.regulator);
  for (int i = 0; config != nullptr && i < scene.arm.actuatorCount(); ++i) {
    const model::Actuator& actuator = scene.arm.actuator(i);
    const model::Range& limits = actuator.limits;
    if (limits.lower < 0 || limits.upper > config->supply_pressure) {
      logWarning("%s has limits of %.0f to %.0f kPa, but the simulated supply gives 0 to %.0f kPa",
                 actuator.name.c_str(), limits.lower / 1e3, limits.upper / 1e3,
                 config->supply_pressure / 1e3);
    }
  }
}

}  // namespace helix_arm::ros_bridge
