#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "helix_arm/estimation/contraction_fit.hpp"
#include "helix_arm/io/data_set.hpp"
#include "helix_arm/model/arm_response.hpp"

/// Measurements that tell how actuators follow their pressures.
namespace helix_arm::procedures {

/// Readings in the order in which they were taken.
struct ResponseSeries {
  model::InputHistory history;  ///< measured pressures
  /// (rows x 1) free lengths, or (rows x 3) positions of the tip [m]; NaN where none was measured.
  Eigen::MatrixXd reading;

  bool empty() const { return history.rows() == 0; }
};

/// The free lengths of one muscle; columns pressure_kpa, length_m and, optionally, time_s and
/// trial.
/// @throws DocumentError if a column is missing, or the time falls within a trial.
ResponseSeries lengthSeriesOf(const io::DataSet& data);

/// Positions of one point of an arm, such as its tip, in any frame that does not move; columns
/// time_s, pressure_1_kpa .., x_m, y_m, z_m and, optionally, seen (0: only the pressures of the row
/// count) and trial.
/// @throws DocumentError as lengthSeriesOf(), or on a pressure beyond the last actuator.
ResponseSeries tipSeriesOf(const io::DataSet& data, int actuators);

/// Columns of such a data set besides the pressures: time_s, three positions, seen and trial.
inline constexpr std::size_t kTipSeriesColumns = 6;

/// The text of such a data set, to 0.1 us, 0.1 mPa and 0.1 um.
/// @param comment  initial comment line, without #.
std::string tipSeriesCsv(const ResponseSeries& tips, const std::string& comment);

/// Appends another file's series, which begins a new trial.
/// @throws DocumentError if only one of them has times.
void append(const ResponseSeries& more, const std::string& file, ResponseSeries& to);

/// The free lengths against the effective pressures, in the same order.
std::vector<estimation::LengthSample> effectiveSamples(const ResponseSeries& lengths,
                                                       const model::Response& response);

/// A curve of effective pressures, continued in a straight line to the largest measured one. Plays
/// keep the effective pressure from reaching it, but a static computation takes pressures
/// themselves.
/// @param fit  with a curve; a quintic that has to be continued becomes a table.
estimation::ContractionFit continuedTo(double pressure, estimation::ContractionFit fit);

}  // namespace helix_arm::procedures
