#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "arguments.hpp"
#include "arrays.hpp"
#include "helix_arm/io/scene.hpp"
#include "solvers.hpp"

namespace helix_arm::python {

/// A loaded scene, as Python holds it. Immutable, so threads may share it.
class Scene {
 public:
  /// @param path       of a scene file.
  /// @param overrides  keys and values as YAML text, as of --set.
  Scene(const std::string& path, const std::vector<io::Override>& overrides);

  const std::string& path() const { return path_; }
  const std::vector<io::Override>& overrides() const { return overrides_; }
  const io::Scene& scene() const { return scene_; }
  const statics::ArmModel& model() const { return scene_.model; }
  const model::Arm& arm() const { return scene_.arm; }
  /// Whether shapes are solved, under a load or along tapered sections.
  bool isLoaded() const { return !model().isLinear(); }
  /// Solvers that calls leave for the next ones.
  Solvers& solvers() const { return solvers_; }

  /// The inputs of an argument, one row per actuator's input.
  /// @throws as Rows does, and what a caller's filter makes of a warning of kPa.
  Rows inputs(const py::handle& given, const char* name) const;
  /// @throws ValueError naming argument, row, actuator and limits.
  void requireWithinLimits(const Rows& inputs) const;
  /// Copies a row of inputs that were within the limits.
  /// @throws ValueError if they are not any more.
  void copyRow(const Rows& inputs, py::ssize_t row, Eigen::VectorXd* q) const;

 private:
  void warnOfKilopascals(const Rows& inputs) const;

  std::string path_;
  std::vector<io::Override> overrides_;
  io::Scene scene_;
  std::vector<int> pressures_;  // the actuators whose inputs are pressures
  mutable Solvers solvers_;     // guarded by itself
};

}  // namespace helix_arm::python
