#pragma once

#include <Eigen/Core>
#include <map>
#include <vector>

#include "helix_arm/estimation/calibration.hpp"
#include "helix_arm/estimation/contraction_fit.hpp"
#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/io/tag_corners.hpp"

namespace helix_arm::procedures {

/// What a data set holds, as its columns tell.
enum class DataKind {
  kCurvatures,  ///< pressure_1_kpa .., curvature_rad: a row a capture
  kTagPoses,    ///< as loadTagPoses() reads them
  kTagCorners,  ///< as loadTagCorners() reads them
  kLengths,     ///< pressure_kpa, length_m: of one muscle that carries nothing
};

/// @throws DocumentError where the columns are of no kind, or of more than one.
DataKind kindOf(const io::DataSet& data);

/// Gauge pressures (rows x actuators) of a data set [Pa].
/// @throws DocumentError with all faults: columns that fit no actuator, actuators that are no
/// pressure's, every pressure outside the limits of its actuator.
Eigen::MatrixXd pressuresWithinLimits(const io::DataSet& data, const model::Arm& arm);

/// The captures of one data set of an arm.
struct LoadedCaptures {
  std::vector<estimation::Capture> captures;
  /// How often each tag was seen that the scene does not have; those sights are left out.
  std::map<int, int> unknown_tags;
  /// Those tags, ascending.
  std::vector<int> unknownIds() const;
};

/// The curvatures, tag poses or tag corners of a data set as those of a scene's arm. Poses are seen
/// from its base, corners are undistorted by its camera. Rows of curvatures are numbered from 1.
/// @throws DocumentError with all faults: those of the file, pressures that are not of the arm's
/// actuators or not within their limits, a curvature < 0 or of an arm of several sections, tags
/// none of which the scene has, corners without a camera or where its distortion cannot be undone,
/// free lengths.
LoadedCaptures loadCaptures(const io::Scene& scene, const io::DataSet& data);

/// The same of corners that were seen just now.
/// @param name  what messages call them.
LoadedCaptures makeCaptures(const io::Scene& scene, const std::vector<io::TagCornerCapture>& seen,
                            const std::string& name);

/// The samples of a data set of free lengths, in its order.
/// @throws DocumentError where it is of another kind.
std::vector<estimation::LengthSample> loadLengths(const io::DataSet& data);

/// A scene's arm and what was measured of it.
estimation::ArmCaptures makeArmCaptures(const io::Scene& scene,
                                        std::vector<estimation::Capture> captures);

}  // namespace helix_arm::procedures
