#include "parameters.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "file_access.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/text.hpp"
#include "helix_arm/io/shipped_files.hpp"
#include "log.hpp"

namespace helix_arm::ros_bridge {
namespace {

template <class... Parts>
std::string join(const Parts&... parts) {
  std::ostringstream out;
  (out << ... << parts);
  return out.str();
}

}  // namespace

std::optional<std::string> filePath(const std::string& given, const std::string& folder,
                                    const std::string& extension) {
  if (given.empty()) return std::nullopt;
  if (given.front() == '/') return given;
  if (io::isPath(given)) return std::nullopt;
  return join(io::shippedFolder(folder), "/", given, extension);
}

void ParameterReader::fault(const std::string& name, const XmlRpc::XmlRpcValue& value,
                            const std::string& rule) {
  faults_.push_back(value.valid() ? join("~", name, " is ", value, "; expected ", rule)
                                  : join("~", name, " is missing; expected ", rule));
}

std::string ParameterReader::text(const std::string& name, const std::string& fallback) {
  XmlRpc::XmlRpcValue value = read(name);
  if (!value.valid()) return fallback;
  if (value.getType() == XmlRpc::XmlRpcValue::TypeString) return static_cast<std::string&>(value);
  fault(name, value, "text");
  return fallback;
}

std::string ParameterReader::frame(const std::string& name, const std::string& fallback) {
  std::string given = text(name, fallback);
  const bool empty = given.empty() && !fallback.empty();
  if (!empty && given.compare(0, 1, "/") != 0) return given;
  fault(name, XmlRpc::XmlRpcValue(given), "a tf2 frame: not empty, no leading slash");
  return fallback;
}

std::string ParameterReader::choice(const std::string& name, const std::string& fallback,
                                    const std::vector<std::string>& words) {
  std::string given = text(name, fallback);
  if (std::find(words.begin(), words.end(), given) != words.end()) return given;
  std::string list;
  for (const std::string& word : words) list += (list.empty() ? "" : " or ") + word;
  fault(name, XmlRpc::XmlRpcValue(given), list);
  return fallback;
}

bool ParameterReader::flag(const std::string& name, bool fallback) {
  XmlRpc::XmlRpcValue value = read(name);
  if (!value.valid()) return fallback;
  if (value.getType() == XmlRpc::XmlRpcValue::TypeBoolean) return static_cast<bool&>(value);
  fault(name, value, "true or false");
  return fallback;
}

double ParameterReader::number(const std::string& name, double fallback,
                               const model::Range& allowed) {
  XmlRpc::XmlRpcValue value = read(name);
  if (!value.valid()) return fallback;
  double number = std::nan("");
  if (value.getType() == XmlRpc::XmlRpcValue::TypeInt) number = static_cast<int&>(value);
  if (value.getType() == XmlRpc::XmlRpcValue::TypeDouble) number = static_cast<double&>(value);
  if (allowed.contains(number)) return number;
  fault(name, value, join("a number from ", allowed.lower, " to ", allowed.upper));
  return fallback;
}

int ParameterReader::count(const std::string& name, int fallback, int lower, int upper) {
  XmlRpc::XmlRpcValue value = read(name);
  if (!value.valid()) return fallback;
  if (value.getType() == XmlRpc::XmlRpcValue::TypeInt) {
    const int number = static_cast<int&>(value);
    if (number >= lower && number <= upper) return number;
  }
  fault(name, value, join("a whole number from ", lower, " to ", upper));
  return fallback;
}

std::string ParameterReader::optionalFile(const std::string& name, const std::string& folder,
                                          const std::string& extension) {
  const std::string given = text(name, "");
  if (given.empty()) return given;
  if (io::isPath(given)) {
    const std::string path = absolute(name, given);
    const auto meant = io::shippedNameOf(path, folder, extension);
    if (!meant) return path;
    fault(name, XmlRpc::XmlRpcValue(path),
          "a file that is there, or " + *meant + ", which is shipped");
    return "";
  }
  std::string path = *filePath(given, folder, extension);
  if (std::filesystem::exists(path)) return path;
  const std::string names = basics::joined(io::shippedNames(folder, extension));
  fault(name, XmlRpc::XmlRpcValue(given),
        join("a path, or the name of a file in ", folder, " of the package: ", names));
  return "";
}

std::string ParameterReader::file(const std::string& name, const std::string& folder,
                                  const std::string& extension) {
  const std::size_t before = faults_.size();
  std::string path = optionalFile(name, folder, extension);
  if (path.empty() && faults_.size() == before) {
    faults_.push_back(join("~", name, " is missing; expected a path, or the name of a file in ",
                           folder, " of the package"));
  }
  return path;
}

std::string ParameterReader::absolute(const std::string& name, const std::string& given) {
  if (given.front() == '/') return given;
  std::string path = (callersFolder() / given).lexically_normal();
  logInfo("~%s is %s: %s", name.c_str(), basics::printable(given).c_str(),
          basics::printable(path).c_str());
  node_.setParam(name, path);  // other nodes read it, too
  return path;
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
  std::string all;
  for (const std::string& line : faults_)
    all += (all.empty() ? "" : "\n") + basics::printable(line);
  throw ParameterError(all);
}

io::Scene requirePneumatic(io::Scene scene) {
  std::string faults;
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    const model::Actuator& actuator = scene.arm.actuator(i);
    if (model::isPressure(actuator.drive)) continue;
    faults += "\n" + actuator.name + " is a tendon; expected muscles and bellows only";
  }
  if (!faults.empty()) {
    throw std::invalid_argument("scene " + scene.name + " cannot be driven by pressure:" + faults);
  }
  return scene;
}

}  // namespace helix_arm::ros_bridge
