#pragma once

#include <Eigen/Core>
#include <istream>
#include <string>
#include <vector>

#include "helix_arm/model/arm_response.hpp"

namespace helix_arm::io {

/// A table of measurements (RFC 4180): `#` comments, a header that names its units, rows of
/// numbers. The column `trial` may hold any names; its values are their indices in trials. Columns
/// that no command reads, and those without a name, may hold anything; they are kept if all their
/// cells are numbers. Where `seen` is 0, positions and orientation may hold anything and are 0.
struct DataSet {
  std::string path;
  std::vector<std::string> columns;
  Eigen::MatrixXd values;           ///< (rows x columns), in the units of the file; all finite
  std::vector<int> lines;           ///< (rows) line of each row in the file, counted from 1
  std::vector<std::string> trials;  ///< their names, in order of appearance; empty if not of a file
  std::string sha256;               ///< hash of the bytes that were read

  /// Index of a column, -1 if absent.
  int find(const std::string& column) const;
};

/// @throws DocumentError naming the columns that are missing, and what was expected.
void requireColumns(const DataSet& data, const std::vector<std::string>& columns,
                    const std::string& expected);

/// Reads a regular file once. Its size is limited before memory is allocated: 64 MiB, 200,000 rows,
/// 1000 columns, 4 million cells.
/// @param skipped  names of columns that may hold anything; they are not part of the result.
/// @throws DocumentError with all faults: `file:line column rule`, without any cell of the file;
/// also if the file is missing or has no header or no rows, is divided by something else than
/// commas, or is another program's table; and for a column whose name is nearly that of a known one
/// (Pressure_2_kpa, x_mm).
DataSet loadDataSet(const std::string& path, const std::vector<std::string>& skipped = {});
/// Reads a stream to its end; the same otherwise.
/// @param name  of the stream, for DataSet::path and faults.
DataSet readDataSet(std::istream& in, const std::string& name,
                    const std::vector<std::string>& skipped = {});

/// @throws DocumentError for a column whose name is nearly that of a known one, as loadDataSet().
void refuseMisspelled(const DataSet& data);

/// Names of the pressures that a data set has no column for.
std::vector<std::string> missingPressures(const DataSet& data, int actuators);
/// The same as a warning; empty if there are none.
std::string missingText(const DataSet& data, int actuators);

/// Gauge pressures (rows x actuators) [Pa] of the columns pressure_1_kpa .. pressure_n_kpa, or
/// pressure_1_pa and so on; a missing column is 0.
/// @throws DocumentError if there is no such column, one beyond the last actuator, or both units of
/// one actuator.
Eigen::MatrixXd pressuresOf(const DataSet& data, int actuators);

/// The measured pressures of a data set: columns pressure_1_kpa .. (one that is missing is 0) and,
/// if they are there, `time_s`, which makes the rows a series, and `trial`, whose changes start a
/// new memory.
/// @throws DocumentError as pressuresOf(), and if the time falls within a trial or is too large for
/// seconds.
model::InputHistory historyOf(const DataSet& data, int actuators);

/// The same of any pressures (rows x actuators) [Pa] in the order of the data set's rows.
model::InputHistory historyOf(const DataSet& data, Eigen::MatrixXd pressure);

}  // namespace helix_arm::io
