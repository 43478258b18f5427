#include "parameters.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "diagnostics.hpp"
#include "file_access.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/basics/text.hpp"
#include "helix_arm/io/shipped_files.hpp"

namespace helix_arm::ros_bridge {

using basics::messageOf;

std::optional<std::string> filePath(const std::string& given, const std::string& folder,
                                    const std::string& extension) {
  if (given.empty()) return std::nullopt;
  if (given.front() == '/') return given;
  if (io::isPath(given)) return std::nullopt;
  return messageOf(io::shippedFolder(folder), "/", given, extension);
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
    const std::string path = absolute(name, given);
    const auto meant = io::shippedNameOf(path, folder, extension);
    if (!meant) return path;
    fault(name, Value(path), "a file that is there, or " + *meant + ", which is shipped");
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
  if (!faults.empty()) {
    throw std::invalid_argument("scene " + scene.name + " cannot be driven by pressure:" + faults);
  }
  return scene;
}

const regulator::Config& requireRegulator(const io::Scene& scene) {
  if (!scene.regulator) {
    throw std::invalid_argument("scene " + scene.name +
                                " has no regulator; add the section `regulator` to it");
  }
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
