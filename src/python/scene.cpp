#include "scene.hpp"

#include <algorithm>
#include <sstream>

#include "helix_arm/control/unit_watch.hpp"

namespace helix_arm::python {
namespace {

std::vector<io::Override> overridesOf(
    const std::vector<std::pair<std::string, std::string>>& given) {
  std::vector<io::Override> out;
  for (const auto& [key, value] : given) out.push_back({key, value});
  return out;
}

}  // namespace

Scene::Scene(const std::string& path,
             const std::vector<std::pair<std::string, std::string>>& overrides)
    : path_(path),
      overrides_(overridesOf(overrides)),
      scene_(io::loadScene(path, overrides_)),
      solvers_(scene_.model) {
  for (int i = 0; i < arm().actuatorCount(); ++i) {
    pressure_.push_back(model::unitOf(arm().actuator(i).drive).pressure);
  }
}

Rows Scene::inputs(const py::handle& given, const char* name) const {
  Rows inputs(given, name, arm().actuatorCount());
  warnOfKilopascals(inputs, name);
  return inputs;
}

void Scene::warnOfKilopascals(const Rows& inputs, const char* name) const {
  double largest = 0;
  for (py::ssize_t row = 0; row < inputs.rows(); ++row) {
    for (py::ssize_t i = 0; i < inputs.columns(); ++i) {
      if (!pressure_[static_cast<std::size_t>(i)]) continue;
      const double pressure = inputs(row, i);
      // Rows of pascals are told by the first of them.
      if (!(pressure >= 0 && pressure < control::UnitWatch::kSuspicious)) return;
      largest = std::max(largest, pressure);
    }
  }
  if (largest == 0) return;
  std::ostringstream message;
  message << name << " is at most " << largest
          << " Pa, which looks like kPa; expected gauge pressures in Pa, so 200 kPa are 200e3";
  if (PyErr_WarnEx(PyExc_UserWarning, message.str().c_str(), 2) != 0) {
    throw py::error_already_set();
  }
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

}  // namespace helix_arm::python
