#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/arm.hpp"

namespace helix_arm::control {

/// Why a target is not taken.
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
};
inline constexpr int kFaultCount = 12;

/// Name of a fault in diagnostics: `not_finite`, `wrong_size`, ...
const char* nameOf(Fault fault);

/// A target that is not taken, and what to tell its sender.
struct Refusal {
  Fault fault;
  std::string message;  ///< names the culprit and the remedy
};

template <class T>
using Checked = std::variant<T, Refusal>;

/// The command that a pressure target asks for.
///
/// @param command  (n) inputs in force [Pa]; those of actuators that the target does not name stay.
/// @param name     actuators, each once; empty for all of them, in the arm's order.
/// @param pressure one a name, gauge, inside the actuator's limits [Pa].
Checked<Eigen::VectorXd> checkPressures(const model::Arm& arm, const model::InputRef& command,
                                        const std::vector<std::string>& name,
                                        const std::vector<double>& pressure);

/// What a regulator is commanded: as a target, but also on its way from the atmosphere to limits
/// that lie beyond it.
Checked<Eigen::VectorXd> checkCommand(const model::Arm& arm, const model::InputRef& command,
                                      const std::vector<std::string>& name,
                                      const std::vector<double>& pressure);

/// What may have waited in some queue.
enum class Timed { kTarget, kReading };

/// Refuses a target or reading that was stamped longer ago than its timeout: it has waited in some
/// queue. And one that is stamped as far ahead: by its sender's clock nobody can tell how old it
/// is.
///
/// @param age  of its stamp, < 0 where that is ahead [s].
std::optional<Refusal> checkAge(double age, double timeout, Timed what = Timed::kTarget);

/// What an instrument reads of all the arm's pressures: (n) gauge [Pa]. Unlike a target it may lie
/// outside the limits.
///
/// @param name  every actuator once, in any order; or empty: the arm's order.
Checked<Eigen::VectorXd> checkReading(const model::Arm& arm, const std::vector<std::string>& name,
                                      const std::vector<double>& pressure);

/// Twists (6 x sections) of a row-by-row list, [v; w] a section; v [m], w [rad].
Checked<model::Twists> checkTwists(int sections, const std::vector<double>& twist);

/// A tip position, base frame [m].
Checked<Eigen::Vector3d> checkPosition(const Eigen::Vector3d& position);

/// A tip pose, base frame [m]; the quaternion's norm is 1 within kQuaternionTolerance.
Checked<lie::SE3> checkPose(const Eigen::Vector3d& position, const Eigen::Quaterniond& rotation);

/// Senders round to a few digits; a forgotten or unnormalised quaternion is farther off than this.
inline constexpr double kQuaternionTolerance = 1e-3;

}  // namespace helix_arm::control
