#pragma once

#include <Eigen/Core>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "helix_arm/estimation/calibration_parameters.hpp"

/// What captures are, and whether anything can be fitted to them.
namespace helix_arm::estimation {

enum class ReadingKind { kCurvature, kTwists, kPoses, kCorners };
ReadingKind kindOf(const Reading& reading);
/// Whether captures with such readings show a parameter with this need; whether the arm is loaded
/// is not looked at.
bool isMet(FitNeed need, ReadingKind kind);
/// Of the errors of such readings: rad, px or m.
const char* unitOf(ReadingKind kind);

/// Parts of a message, one after the other.
template <class... Parts>
std::string text(const Parts&... parts) {
  std::ostringstream out;
  (out << ... << parts);
  return out.str();
}
/// "100, 0, 50 kPa".
std::string pressureText(const Eigen::VectorXd& pressure);

/// The same arms with the captures that hold readings.
std::vector<ArmCaptures> withReadings(const std::vector<ArmCaptures>& arms);
/// Of captures of which there is at least one.
const Reading& firstReading(const std::vector<ArmCaptures>& arms);

/// A reason why nothing can be fitted.
struct Verdict {
  CalibrationStatus status;
  std::string reason;
};
/// What is wrong with the captures, all of which hold readings.
std::optional<Verdict> unsound(const std::vector<ArmCaptures>& arms);
/// Why sound captures do not tell what is asked for.
std::optional<Verdict> unfit(const std::vector<ArmCaptures>& arms,
                             const CalibrationOptions& options, ReadingKind kind);

/// Captures as groups at the same pressures.
struct Groups {
  std::vector<int> of;                    ///< (captures)
  std::vector<Eigen::VectorXd> pressure;  ///< (groups)
};
Groups groupByPressure(const std::vector<ArmCaptures>& arms);

}  // namespace helix_arm::estimation
