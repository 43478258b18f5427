#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "captures.hpp"
#include "helix_arm/calibration/suspects.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"

/// A walk through the actuators of a new rig, one at a time with little pressure. It tells whether
/// every hose, sensor and tag is where the scene says:
///
///     const Eigen::MatrixXd plan = walkPlan(scene.arm);
///     const CalibrationData data = walkSimulatedRig(scene, rig, plan, seed);  // or recorded
///     const Commissioning found = commission(path, {}, data, plan);
namespace helix_arm::procedures {

/// Pressures (steps x actuators) [Pa]: rest, each actuator alone at 15 % and 30 % of its range,
/// neighbours of a section together at 30 %, rest.
Eigen::MatrixXd walkPlan(const model::Arm& arm);

/// The simulated regulator of a scene; for a scene without one, one that reaches all limits.
regulator::SimulatedRegulatorConfig simulatedRegulatorOf(const io::Scene& scene);

/// Captures of a simulated rig at the steps of a plan, in rendered pictures.
/// @throws std::invalid_argument if a scene lacks camera or tags, or the rig has other actuators.
CalibrationData walkSimulatedRig(const io::Scene& scene, const io::Scene& rig,
                                 const Eigen::MatrixXd& plan, std::uint32_t seed);

/// Motion by one actuator alone.
struct WalkedChannel {
  std::string actuator;
  /// From rest, where the tip goes across the arm: along y and z of the base [m]; NaN if unseen.
  Eigen::Vector2d expected, seen;
  /// ok; answers_as (another actuator bends); dead; weak or strong (beside the others); wrong_sign;
  /// other_direction (that of no actuator); unseen (no shape explains the tags).
  std::string verdict;
  int answers_as = -1;  ///< index of the actuator that bends, if it is another one
};

/// Measured pressures of an actuator: gain times the commanded ones, and an offset.
struct WalkedSensor {
  std::string actuator;
  double gain, offset;  ///< offset at rest [Pa]
  std::string verdict;  ///< ok, no_reading, reads_as (another actuator's pressure), gain or offset
  int reads_as = -1;    ///< index of the actuator that it reads, if it is another one
};

/// Result of a walk.
struct Commissioning {
  std::vector<WalkedChannel> channels;  ///< (actuators)
  std::vector<WalkedSensor> sensors;    ///< (actuators)
  /// Ids of those that should face the camera in most steps, and were never seen.
  std::vector<int> missing_tags;
  /// Usual causes that explain the captures, best first, as estimation::suspectsOf() tells.
  std::vector<estimation::Suspect> suspects;
  /// In words, the leading one first; empty if all is where the scene says.
  std::vector<std::string> findings;
};

/// @param data  one capture of tags per step of the plan, in its order.
/// @throws std::invalid_argument on other captures, DocumentError if the scene has faults.
Commissioning commission(const std::string& path, const std::vector<io::Override>& overrides,
                         const CalibrationData& data, const Eigen::MatrixXd& plan);

/// The text of the scene without a suspect, or why the scene cannot say it; the other is empty.
struct Correction {
  std::string scene_text, reason;
};
/// @param suspect  counted from 1; 0: channels that answer as others, else the first.
/// @throws std::invalid_argument if there is no such suspect.
Correction correct(const std::string& path, const std::vector<io::Override>& overrides,
                   const CalibrationData& data, const Commissioning& found, int suspect);

}  // namespace helix_arm::procedures
