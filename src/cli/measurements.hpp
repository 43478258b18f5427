#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/localization/twist_fit.hpp"
#include "output.hpp"

namespace helix_arm::cli {

/// @throws CallerError where the scene has tendons: data sets give pressures.
void requirePressureDriven(const io::Scene& scene);

/// Why the model has no shape where its load finds no balance, as text of a result.
std::string reasonForNoShape(statics::SolveStatus status);
/// Where the search for a measured shape began, as text of a result; empty where at the model's.
std::string noteOnStart(const statics::Solution& solution);

/// One capture of tag poses and the shape fitted to it.
struct FittedCapture {
  int number;                                     ///< as the file counts them
  Eigen::VectorXd pressure;                       ///< (n) gauge [Pa]
  std::vector<estimation::PoseObservation> seen;  ///< the tags that the scene has
  std::vector<int> unknown_tags;                  ///< ids that it has not
  statics::Solution model;                        ///< at these pressures
  estimation::FitStatus status;
  std::string reason;  ///< why it did not converge; empty where it did
  /// Absent where the tags do not determine a shape, or no shape fits most of them.
  std::optional<estimation::TwistFit> fit;
  /// Set where its residuals are far larger than is usual among the captures: that RMS [m].
  std::optional<double> usual_rms;

  bool converged() const { return status == estimation::FitStatus::kConverged; }
  /// Fitted, all its tags agree, and as well as those of the others.
  bool sound() const { return converged() && fit->outliers() == 0 && !usual_rms; }
  /// Ids of the tags that do not fit.
  std::vector<int> outlierTags(const estimation::TagLayout& layout) const;
};

/// Fits every capture of a data set of tag poses by itself, from the model's shape or, where its
/// load finds no balance, that without load. Pressures outside the limits count as at them: they
/// are but a start.
/// @throws CallerError where the scene has no tags or has tendons, io::DocumentError on faulty
/// data.
std::vector<FittedCapture> fitCaptures(const io::Scene& scene, const io::DataSet& data);

/// What fit and evaluate report alike of a capture.
nlohmann::json captureJson(const FittedCapture& capture, const estimation::TagLayout& layout);

/// Names a capture that no shape explains, with its RMS, what is usual, and what to do; empty for
/// the others.
std::string noteOnScatter(const FittedCapture& capture);

/// Pose of the fitted tip, seen from where the arm's base nominally is.
lie::SE3 measuredTip(const estimation::TwistFit& fit);

/// Why there is no result; empty where some capture is sound.
std::string reasonForNoFit(const std::vector<FittedCapture>& captures);

/// Why these tags do not determine the arm's shape: which sections have too few of them.
/// @param tags    indices in the scene's layout.
/// @param needed  tags that each section should have.
std::string whyUndetermined(const io::Scene& scene, const std::vector<int>& tags, int needed);

/// The middle value; nothing of none.
std::optional<double> median(std::vector<double> values);

/// The text of an option `--history` of a subcommand.
inline constexpr char kHistoryHelp[] =
    "data set with the measured pressures in the order taken: pressure_1_kpa, .., and optionally "
    "time_s and trial; the arm's response follows them";

/// The history of a file. @throws CallerError if the arm has tendons, io::DocumentError on faults.
model::InputHistory historyOfFile(const io::Scene& scene, const std::string& path);

/// What a result without history leaves out; empty for an arm without responses.
std::string noteOnResponse(const model::Arm& arm);

/// Adds `response` {history_rows, memory_known, half_width_pa, uncertainty_pa, note} to a result;
/// nothing for an arm without responses.
/// @param rows  of the history; 0 without one.
void addResponse(const model::Arm& arm, const model::ArmResponse& response, Eigen::Index rows,
                 nlohmann::json& result);

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
