#pragma once

#include "command.hpp"
#include "helix_arm/io/data_set.hpp"
#include "helix_arm/localization/twist_fit.hpp"
#include "procedures/body_recording.hpp"

namespace helix_arm::cli {

/// @throws CallerError where the scene has tendons: data sets give pressures.
void requirePressureDriven(const io::Scene& scene);

/// Why the model has no shape where its load finds no balance, as text of a result.
std::string reasonForNoShape(statics::SolveStatus status);
/// Where the search for a measured shape began, as text of a result; empty where at the model's.
std::string noteOnStart(const statics::Solution& solution);

/// Pose of the fitted tip, seen from where the arm's base nominally is.
lie::SE3 measuredTip(const estimation::TwistFit& fit);

/// Why these tags do not determine the arm's shape: which sections have too few of them.
/// @param tags    indices in the scene's layout.
/// @param needed  tags that each section should have.
std::string whyUndetermined(const io::Scene& scene, const std::vector<int>& tags, int needed);

/// The text of an option `--history` of a subcommand.
inline constexpr char kHistoryHelp[] =
    "data set with the measured pressures in the order taken: pressure_1_kpa, .., and optionally "
    "time_s and trial; the arm's response follows them";

/// The history of a file. @throws CallerError if the arm has tendons, io::DocumentError on faults.
/// Prints a warning on stderr if the data set has no column for some pressures, which count as 0.
/// @return their names, for a result's `missing_columns`.
json missingColumns(const io::Scene& scene, const io::DataSet& data);

model::InputHistory historyOfFile(const io::Scene& scene, const std::string& path);

/// Note on the parts that a result without history leaves out; empty for an arm without responses.
std::string noteOnResponse(const model::Arm& arm);

/// Adds `response` {history_rows, memory_known, half_width_pa, uncertainty_pa, note} to a result;
/// nothing for an arm without responses.
/// @param rows  of the history; 0 without one.
void addResponse(const model::Arm& arm, const model::ArmResponse& response, Eigen::Index rows,
                 json& result);

/// Adds `--pressures` and `--offset-s`, for recordings of bodies.
void addPressures(CLI::App& command, procedures::RecordedPressures& pressures);

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

/// Numbers (rows x names) of the named columns. @throws CallerError naming those that are missing.
Eigen::MatrixXd columnsOf(const io::DataSet& data, const std::vector<std::string>& names);

}  // namespace helix_arm::cli
