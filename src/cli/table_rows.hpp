#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/scene.hpp"

namespace helix_arm::cli {

/// The table of an option: that of a file, or of stdin where the path is "-".
/// Columns of words that forward and inverse print are left out.
/// @throws io::DocumentError on a table with faults.
io::DataSet tableOf(const std::string& path);

/// Inputs (rows x actuators) [Pa or rad] of the columns pressure_1_kpa or pressure_1_pa and so on
/// (a missing one is 0), or, where the table has one of them, of all of input_1 and so on in SI
/// units.
/// @throws CallerError naming the line, the actuator and its limits; io::DocumentError
/// on missing columns.
Eigen::MatrixXd inputRowsOf(const io::Scene& scene, const io::DataSet& data);

/// Names of the columns of positions x_m, y_m, z_m, or, where the table has qx, of poses; with the
/// prefix tip_ where the table has those of a result alone.
std::vector<std::string> poseColumns(const io::DataSet& data);

/// Numbers (rows x names) of the named columns. @throws CallerError naming those that are missing.
Eigen::MatrixXd columnsOf(const io::DataSet& data, const std::vector<std::string>& names);

}  // namespace helix_arm::cli
