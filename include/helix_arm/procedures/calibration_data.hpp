#pragma once

#include <optional>
#include <string>
#include <vector>

#include "helix_arm/estimation/calibration.hpp"
#include "helix_arm/io/provenance.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/response_series.hpp"

/// The measurements that a calibration is made from.
namespace helix_arm::procedures {

/// Measurements of one arm.
struct CalibrationData {
  std::vector<estimation::Capture> captures;
  ResponseSeries lengths;  ///< free lengths of one muscle
  ResponseSeries tips;     ///< positions of the tip through motions; also gives the effective
                           ///< pressures of captures
  std::vector<io::Provenance::Data> sources;
  std::vector<std::string> warnings;
};

/// Adds the captures of one file. If their numbers are already used, they are renumbered, with a
/// warning.
void addCaptures(std::vector<estimation::Capture> captures, const std::string& file,
                 CalibrationData& data);

/// Adds a data set of any kind: curvatures, tag poses, tag corners, free lengths, series of the
/// tip.
/// @throws DocumentError with every fault of its rows.
void addDataSet(const io::Scene& scene, const io::DataSet& set, CalibrationData& data);

/// Reads data sets of any kind.
/// @throws DocumentError with every fault of a file.
CalibrationData loadCalibrationData(const io::Scene& scene, const std::vector<std::string>& paths);

/// The message that names two sources with the same content, if there are any; such data would
/// count twice.
std::optional<std::string> repeatedSource(const std::vector<io::Provenance::Data>& sources);

}  // namespace helix_arm::procedures
