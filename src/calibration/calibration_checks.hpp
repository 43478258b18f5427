#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/calibration/calibration_parameters.hpp"

/// Properties of captures, and checks whether parameters can be fitted to them.
namespace helix_arm::estimation {

using basics::messageOf;

enum class ReadingKind { kCurvature, kTwists, kPoses, kCorners };
/// Requires at least one capture.
ReadingKind kindOf(const std::vector<ArmCaptures>& arms);
/// Whether captures with such readings meet a need. Does not check whether the arm is loaded.
bool isMet(FitNeed need, ReadingKind kind);
/// Unit of the errors of such readings: rad, px or m.
const char* unitOf(ReadingKind kind);

/// "100, 0, 50 kPa".
std::string pressureText(const Eigen::VectorXd& pressure);

/// Reason for refusing a fit.
struct Verdict {
  CalibrationStatus status;
  std::string reason;
};
/// Faults of the captures.
std::optional<Verdict> unsound(const std::vector<ArmCaptures>& arms);
/// Why sound captures cannot determine the requested parameters.
std::optional<Verdict> unfit(const std::vector<ArmCaptures>& arms,
                             const CalibrationOptions& options);

/// Captures grouped by equal pressures.
struct Groups {
  std::vector<int> of;                    ///< (captures) index of the group
  std::vector<Eigen::VectorXd> pressure;  ///< (groups) [Pa]
};
Groups groupByPressure(const std::vector<ArmCaptures>& arms);

}  // namespace helix_arm::estimation
