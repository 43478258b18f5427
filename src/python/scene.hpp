#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/statics/inverse.hpp"

namespace helix_arm::python {

/// Solvers of one model that are not in use, of any options: the last ones that were given back.
/// Making one samples a thousand starts, which takes 50 times as long as a target. Threads may
/// share them.
class Solvers {
 public:
  /// A solver of one thread, given back at its end.
  using Loan =
      std::unique_ptr<statics::InverseSolver, std::function<void(statics::InverseSolver*)>>;

  /// @param model  must outlive the solvers.
  explicit Solvers(const statics::ArmModel& model);
  /// @throws as InverseSolver does.
  Loan take(const statics::InverseOptions& options);
  /// How many were made.
  std::int64_t made() const { return made_; }

 private:
  struct Kept {
    statics::InverseOptions options;
    std::unique_ptr<statics::InverseSolver> solver;
  };

  void giveBack(const statics::InverseOptions& options,
                std::unique_ptr<statics::InverseSolver> solver) noexcept;

  const statics::ArmModel& model_;
  std::atomic<std::int64_t> made_{0};
  basics::Mutex mutex_;
  std::vector<Kept> kept_ HELIX_ARM_GUARDED_BY(mutex_);  // the last is at the end
};

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
