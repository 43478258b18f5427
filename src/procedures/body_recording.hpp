#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/scene.hpp"
#include "settle_watch.hpp"

namespace helix_arm::io {
struct BodyTable;
}

namespace helix_arm::procedures {

/// Where the pressures of a recording of bodies are.
struct RecordedPressures {
  /// Table with time_s and pressure_1_kpa ..; empty: the recording itself is one.
  std::string path;
  /// Added to its times, gives those of the recording [s]; absent: found by lagBetween().
  std::optional<double> offset = 0.0;
};

/// Measured pressures over time.
struct TimedPressures {
  std::vector<double> time;  ///< (rows) ascending [s]
  Eigen::MatrixXd values;    ///< (rows x actuators) gauge [Pa]
};

/// How much later one recording's clock shows a motion.
struct ClockLag {
  double seconds = 0.0;
  double correlation = 0.0;  ///< of the two activities then, at most 1
};

/// The lag at which the activity of a recording resembles that of another one best: the sum of the
/// magnitudes of its changes. `from` + seconds is the clock of `to`.
/// @param from, to  (rows) ascending times [s], and (rows x any) what changes.
ClockLag lagBetween(const std::vector<double>& from, const Eigen::MatrixXd& of_from,
                    const std::vector<double>& to, const Eigen::MatrixXd& of_to);

/// The times at which pressures and bodies of a recording are at rest: a sample each, the median of
/// its rows.
/// @param path  of the recording.
/// @param own  the pressures in the recording itself, taken if `pressures` names no other table.
/// @param notes  gets the offset of clocks that was found.
/// @throws DocumentError where the clocks cannot be told apart, or the arm is never at rest.
std::vector<Sample> samplesAtRest(const io::Scene& scene, const io::BodyTable& table,
                                  const std::string& path, const TimedPressures& own,
                                  const RecordedPressures& pressures, const SettleRules& rules,
                                  std::vector<std::string>& notes);

/// A data set of measurements of the scene's arm. A recording of its bodies (io::loadBodyTable())
/// becomes a data set of tag poses, with one capture for each time at which pressures and arm are
/// at rest; every other file is read as it is.
/// @param notes  gets the offset of clocks that was found.
/// @throws DocumentError with all faults; where the clocks cannot be told apart, or the arm is
/// never at rest.
io::DataSet measurementsOf(const io::Scene& scene, const std::string& path,
                           const RecordedPressures& pressures, std::vector<std::string>& notes);

}  // namespace helix_arm::procedures
