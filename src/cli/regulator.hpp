#pragma once

#include <memory>
#include <optional>
#include <string>

#include "command.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/regulator/config.hpp"
#include "helix_arm/regulator/driver.hpp"
#include "nlohmann/json.hpp"

// What `helix_arm regulator SCENE` can do.

namespace helix_arm::cli {

struct RegulatorOptions {
  std::string scene;
  std::string pressure_kpa;       ///< set
  std::optional<double> seconds;  ///< probe, set, emulate
  bool yes = false;               ///< set: air may move
  int realtime_priority = 0;      ///< guard: as regulator::scheduleRealtime() where it is allowed
};

int probeRegulator(const RegulatorOptions& options, const GlobalOptions& global);
int setRegulator(const RegulatorOptions& options, const GlobalOptions& global);
int ventRegulator(const RegulatorOptions& options, const GlobalOptions& global);
int guardRegulator(const RegulatorOptions& options, const GlobalOptions& global);
int emulateRegulator(const RegulatorOptions& options, const GlobalOptions& global);

/// Loads a scene that has a regulator.
/// @throws CallerError where it has none; as loadScene().
io::Scene loadRegulatedScene(const RegulatorOptions& options, const GlobalOptions& global);

std::unique_ptr<regulator::Driver> makeDriver(const io::Scene& scene);

/// How venting went.
struct Vented {
  Eigen::VectorXd pressure;  ///< (channels) last readings, gauge, NaN without [Pa]
  std::string reason;        ///< why it is not vented; empty: it is
};

/// Vents through a driver that is connected, and goes on to, until no channel has pressure; for as
/// long as the scene's safety.vent_time_s at most.
/// @throws regulator::LinkError.
Vented ventAll(regulator::Driver& driver, const io::Scene& scene);

/// "muscle_1 12.3 kPa, muscle_2 no reading".
std::string pressureText(const io::Scene& scene, const Eigen::VectorXd& pressure, int decimals = 1);
/// Numbers, null where there is none.
nlohmann::json readingsJson(const Eigen::VectorXd& pressure);
/// A reading for csv, empty where there is none.
std::string readingCell(double pressure);

}  // namespace helix_arm::cli
