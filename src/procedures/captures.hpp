#pragma once

#include <Eigen/Core>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "body_recording.hpp"
#include "helix_arm/calibration/calibration.hpp"
#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/provenance.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/io/tag_table.hpp"
#include "helix_arm/localization/capture_check.hpp"
#include "response_series.hpp"

namespace helix_arm::procedures {

using PosesOfTags = std::vector<estimation::PoseObservation>;
using CornersOfTags = std::vector<estimation::CornerObservation>;

/// Kind of a data set, determined by its columns.
enum class DataKind {
  kCurvatures,  ///< pressure_1_kpa .., curvature_rad: one row per capture
  kTagPoses,    ///< as loadTagPoses() reads them
  kTagCorners,  ///< as loadTagCorners() reads them
  kLengths,     ///< pressure_kpa, length_m: of one muscle without load
  kTipSeries,   ///< time_s, x_m, y_m and no tag: of an arm in motion; pressures
};

/// @throws DocumentError if the columns match no kind, or more than one.
DataKind kindOf(const io::DataSet& data);

/// Gauge pressures (rows x actuators) of a data set [Pa].
/// @throws DocumentError with all faults: columns without an actuator, actuators that are not
/// driven by pressure, every pressure outside the limits of its actuator.
Eigen::MatrixXd pressuresWithinLimits(const io::DataSet& data, const model::Arm& arm);

/// The captures of one data set of an arm.
struct LoadedCaptures {
  std::vector<estimation::Capture> captures;
  std::vector<int> unknown_ids;  ///< of tags that the scene does not have, ascending; omitted
};

/// Treatment of pressures outside the actuators' limits: a fault, or left to a calibration, which
/// names what usually explains them.
enum class OutsideLimits { kFault, kKept };

/// Load that hangs on the arm in each capture, by its number: columns load_mass_kg or
/// load_force_x_n .. load_force_z_n (world frame), at load_s: 0 at the base, the number of sections
/// at the tip, which is the default. Nothing where they are 0, or say what the scene's load has
/// there.
/// @throws DocumentError with all faults: an arm without K_eps, a mass without gravity, a place off
/// the arm, another load than the scene has there, a load that changes within a capture.
std::map<int, statics::PointLoad> payloadsOf(const io::Scene& scene, const io::DataSet& data);

/// The scene's model, under what hangs on the arm as well.
statics::ArmModel modelUnder(const io::Scene& scene,
                             const std::optional<statics::PointLoad>& payload);

/// Loads the curvatures, tag poses or tag corners of a data set of a scene's arm. Poses are seen
/// from its base; corners are undistorted with its camera. Rows of curvatures are numbered from 1.
/// @throws DocumentError with all faults: those of the file, pressures that are not of the arm's
/// actuators or not within their limits, a curvature < 0 or of an arm of several sections, tags
/// none of which the scene has, corners without a camera or where its distortion cannot be undone,
/// free lengths, a series of the tip.
LoadedCaptures loadCaptures(const io::Scene& scene, const io::DataSet& data,
                            OutsideLimits outside = OutsideLimits::kFault);

/// The same for corners from memory; pressures beyond the limits are kept.
/// @param name  their name in messages.
LoadedCaptures makeCaptures(const io::Scene& scene, const std::vector<io::TagCornerCapture>& seen,
                            const std::string& name);

/// The same for poses of bodies from memory, seen from their frame F.
LoadedCaptures makeCaptures(const io::Scene& scene, std::vector<io::TagPoseCapture> seen,
                            const std::string& name);

/// A scene's arm and its captures.
estimation::ArmCaptures makeArmCaptures(const io::Scene& scene,
                                        std::vector<estimation::Capture> captures);

/// Fits a shape to the tags of a capture, from this start.
///
/// @param fitter   of the scene's tags.
/// @param reading  tag poses or, if the scene has a camera, tag corners.
/// @return the fitter's result, valid until its next fit.
const estimation::TwistFit& fitTags(const io::Scene& scene, const estimation::Reading& reading,
                                    const model::Shape& start, estimation::TwistFitter& fitter);

/// The model's shape at the pressures of a capture, within the limits and under what hangs on the
/// arm, and the shape of its tags.
struct FittedShape {
  statics::Solution model;
  std::optional<estimation::TwistFit> fit = {};  ///< absent for corners without a camera
  /// Usual RMS of tag positions, where no shape explains these: estimation::checkCaptures() [m].
  std::optional<double> usual_rms = {};
};
/// Fits every capture by itself, from the model's shape or, where its load finds no balance, that
/// without load. Requires a scene with tags.
std::vector<FittedShape> fitShapes(const io::Scene& scene,
                                   const std::vector<estimation::Capture>& captures);

/// "no shape explains it: its tags are off by RMS 54.0 mm, usual are 13.7 mm; ...".
std::string scatterText(double rms, double usual);

/// A warning that names the captures of tag positions that no shape explains; empty without any.
std::vector<std::string> warningsOfScatter(const io::Scene& scene,
                                           const std::vector<estimation::Capture>& captures);

// The measurements that a calibration is made from.

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

/// Reads data sets of any kind, and recordings of bodies.
/// @param pressures  of the recordings.
/// @throws DocumentError with every fault of a file.
CalibrationData loadCalibrationData(const io::Scene& scene, const std::vector<std::string>& paths,
                                    const RecordedPressures& pressures = {});

/// The message that names two sources with the same content, if there are any; such data would
/// count twice.
std::optional<std::string> repeatedSource(const std::vector<io::Provenance::Data>& sources);

}  // namespace helix_arm::procedures
