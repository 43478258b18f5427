#pragma once

#include <string>
#include <vector>

#include "calibration/stand_fit.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/provenance.hpp"
#include "helix_arm/io/scene.hpp"

/// A scene's contraction curve and K_eps from muscles on a testing machine.
namespace helix_arm::procedures {

/// The readings of data sets, one run each.
struct StandData {
  std::vector<estimation::StandRun> runs;
  std::vector<io::Provenance::Data> sources;
};
/// @throws io::DocumentError on a data set with faults, or without the columns pressure_kpa (or
///     pressure_pa), length_m and force_n.
StandData loadStand(const std::vector<std::string>& paths);

/// The law of a scene's muscle. @param contraction  name of its curve; empty if the arm has one.
/// @throws std::invalid_argument naming the curves, or the missing K_eps.
estimation::StandLaw standLawOf(const io::Scene& scene, const std::string& contraction);

/// Result of a calibration on a testing machine.
struct StandOutcome {
  std::string contraction;  ///< name of the curve
  estimation::StandFit fit;
  estimation::StandComparison all;  ///< of all readings, if it was fitted
  std::string scene_text;           ///< of the calibrated scene; empty if nothing was fitted
};

/// Fits curve and K_eps, and makes the calibrated scene. Writes no file.
/// @param path, overrides  file and overrides of the calibrated scene.
/// @param contraction  name of the curve; empty if the arm has one.
/// @param muscles  in parallel, by which it was measured.
/// @throws std::invalid_argument if the arm has several curves, as one K_eps is of all muscles;
///     DocumentError if the scene has faults, before or after.
StandOutcome calibrateStand(const std::string& path, const std::vector<io::Override>& overrides,
                            const std::string& contraction, int muscles, const StandData& data);

}  // namespace helix_arm::procedures
