#pragma once

#include "helix_arm/io/data_set.hpp"
#include "helix_arm/model/arm_response.hpp"

namespace helix_arm::io {

/// The measured pressures of a data set: columns pressure_1_kpa .. (one that is missing is 0) and,
/// if they are there, `time_s`, which makes the rows a series, and `trial`, whose changes start a
/// new memory.
/// @throws DocumentError as pressuresOf(), and if the time falls within a trial.
model::InputHistory historyOf(const DataSet& data, int actuators);

/// The same of any pressures (rows x actuators) [Pa] in the order of the data set's rows.
model::InputHistory historyOf(const DataSet& data, Eigen::MatrixXd pressure);

}  // namespace helix_arm::io
