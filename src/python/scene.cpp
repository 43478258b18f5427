#include "scene.hpp"

#include <sstream>
#include <thread>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::python {
namespace {

constexpr int kMostThreads = 1024;

std::vector<io::Override> overridesOf(
    const std::vector<std::pair<std::string, std::string>>& given) {
  std::vector<io::Override> out;
  for (const auto& [key, value] : given) out.push_back({key, value});
  return out;
}

}  // namespace

Scene::Scene(const std::string& path,
             const std::vector<std::pair<std::string, std::string>>& overrides)
    : path_(path), overrides_(overridesOf(overrides)), scene_(io::loadScene(path, overrides_)) {}

Rows Scene::inputs(const py::handle& given, const char* name) const {
  return Rows(given, name, arm().actuatorCount());
}

void Scene::requireWithinLimits(const Rows& inputs, const char* name) const {
  const model::Arm& arm = this->arm();
  for (py::ssize_t i = 0; i < inputs.columns(); ++i) {
    const model::Actuator& actuator = arm.actuator(static_cast<int>(i));
    const model::Range limits = actuator.limits;
    for (py::ssize_t row = 0; row < inputs.rows(); ++row) {
      if (limits.contains(inputs(row, i))) continue;
      const model::DriveUnit unit = model::unitOf(actuator.drive);
      std::ostringstream message;
      message.precision(12);
      message << name << " asks " << actuator.name << " for " << inputs(row, i) << " " << unit.si;
      if (!inputs.single()) message << " in row " << row;
      message << "; its limits are " << limits.lower << " to " << limits.upper << " " << unit.si
              << (unit.pressure ? " (gauge)" : "");
      throw std::invalid_argument(message.str());
    }
  }
}

std::size_t threadCount(int threads) {
  basics::require(threads >= 0 && threads <= kMostThreads, "threads is ", threads,
                  "; expected 1 to ", kMostThreads, ", or 0 for all cores");
  if (threads > 0) return static_cast<std::size_t>(threads);
  return std::max(1u, std::thread::hardware_concurrency());
}

}  // namespace helix_arm::python
