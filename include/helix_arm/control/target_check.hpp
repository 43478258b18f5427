#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/arm.hpp"

namespace helix_arm::control {

/// Why a target is refused.
enum class Fault {
  kNotFinite,
  kWrongSize,
  kUnknownName,
  kDuplicateName,
  kOutOfRange,
  kWrongFrame,
  kNotUnitQuaternion,
  kUnknownMode,
  kOtherCommander,
  kNotConverged,
  kNotEnabled,
  kStale,
  kRested,
  kBlocked,  ///< the arm would come too close to a zone that it keeps out of
};
inline constexpr int kFaultCount = 14;

/// Remedy for stamps that are `age` behind the clock they are compared with [s].
const char* whyLate(double age);

/// Name of a fault in diagnostics: `not_finite`, `wrong_size`, ...
const char* nameOf(Fault fault);

using Refusal = basics::Refusal<Fault>;

template <class T>
using Checked = basics::Checked<T, Fault>;

/// The command that results from a pressure target.
///
/// @param command  (n) current inputs [Pa]; actuators that the target does not name keep theirs.
/// @param name     actuators, each at most once; empty for all of them, in the arm's order.
/// @param pressure one per name, gauge, inside the actuator's limits [Pa].
Checked<Eigen::VectorXd> checkPressures(const model::Arm& arm, const model::InputRef& command,
                                        const std::vector<std::string>& name,
                                        const std::vector<double>& pressure);

/// The command for a regulator: like checkPressures(), but pressures between the atmosphere and the
/// limits are accepted as well.
Checked<Eigen::VectorXd> checkCommand(const model::Arm& arm, const model::InputRef& command,
                                      const std::vector<std::string>& name,
                                      const std::vector<double>& pressure);

/// Kind of message whose age is checked.
enum class Timed { kTarget, kReading };

/// Refuses a target or reading whose stamp is older than its timeout, as after waiting in a queue.
/// Refuses one whose stamp is as far in the future, too: its age cannot be determined from the
/// sender's clock.
///
/// @param age  age of the stamp [s]; < 0 if it is in the future.
std::optional<Refusal> checkAge(double age, double timeout, Timed what = Timed::kTarget);

/// Refuses a target of the commander whose arm somebody else has brought to rest.
///
/// @param pause  silence after which its next target counts [s].
Refusal restedRefusal(double pause);

/// Readings outside this range mean a broken sensor, or another unit: gauge [Pa].
inline constexpr model::Range kPossibleReading{-2e5, 1e8};

/// Readings of all pressures of the arm: (n) gauge [Pa]. Unlike targets, they may lie outside the
/// limits, but not outside kPossibleReading.
///
/// @param name  every actuator once, in any order; empty for the arm's order.
Checked<Eigen::VectorXd> checkReading(const model::Arm& arm, const std::vector<std::string>& name,
                                      const std::vector<double>& pressure);

/// Twists (6 x sections) from a row-by-row list, [v; w] per section; v [m], w [rad].
Checked<model::Twists> checkTwists(int sections, const std::vector<double>& twist);

/// A tip position, base frame [m].
Checked<Eigen::Vector3d> checkPosition(const Eigen::Vector3d& position);

/// A tip pose, base frame [m]; the norm of the quaternion must be 1 within kQuaternionTolerance.
Checked<lie::SE3> checkPose(const Eigen::Vector3d& position, const Eigen::Quaterniond& rotation);

/// Tolerates senders that round to a few digits; a forgotten or unnormalised quaternion deviates
/// more.
inline constexpr double kQuaternionTolerance = 1e-3;

/// Notices a commander that seems to send kilopascals where pascals are expected: all its pressures
/// have been below 1 kPa, and not all 0, for kPatience since its first target. A slow ramp from 0
/// passes 1 kPa sooner. No clock: times are arguments [s].
class UnitWatch {
 public:
  static constexpr double kSuspicious = 1e3;  ///< pressures of arms are higher [Pa]
  static constexpr double kPatience = 2.0;    ///< [s]
  /// Commanders that are remembered; further ones are not watched.
  static constexpr int kMost = 32;

  /// @param largest  largest pressure of a target that was accepted, gauge [Pa].
  void note(double now, const std::string& commander, double largest);

  /// The warning about one commander, once for each; empty if there is none.
  std::string warning(double now);

 private:
  struct Record {
    double since = 0;      ///< first target that was not all 0
    double largest = 0;    ///< so far [Pa]
    bool settled = false;  ///< warned of, or known to send pascals
  };
  std::map<std::string, Record> records_;
};

/// The warning about inputs (rows x n, [Pa or rad]) whose pressures are all below
/// UnitWatch::kSuspicious and not all 0; empty if there is none.
/// @param what  their name in it, such as "--input".
std::string kilopascalWarning(const std::string& what, const model::Arm& arm,
                              const Eigen::Ref<const Eigen::MatrixXd>& inputs);

}  // namespace helix_arm::control
