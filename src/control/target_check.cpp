#include "helix_arm/control/target_check.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>

#include "basics/quote.hpp"
#include "basics/text.hpp"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/statics/inverse.hpp"

namespace helix_arm::control {
namespace {

using Bounds = model::Range (*)(const model::Range& limits);

constexpr std::array<const char*, kFaultCount> kNames = {
    "not_finite",      "wrong_size",    "unknown_name",        "duplicate_name",
    "out_of_range",    "wrong_frame",   "not_unit_quaternion", "unknown_mode",
    "other_commander", "not_converged", "not_enabled",         "stale",
    "rested",          "blocked"};

template <class... Parts>
Refusal refuse(Fault fault, const Parts&... parts) {
  std::ostringstream message;
  (message << ... << parts);
  return {fault, message.str()};
}

int indexOf(const model::Arm& arm, const std::string& name) {
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    if (arm.actuator(i).name == name) return i;
  }
  return -1;
}

// The pressures (n) of the arm after a change of those that `name` lists.
Checked<Eigen::VectorXd> assign(const model::Arm& arm, Eigen::VectorXd wanted,
                                const std::vector<std::string>& name,
                                const std::vector<double>& pressure, Bounds bounds) {
  const std::size_t expected = name.empty() ? arm.actuatorCount() : name.size();
  if (pressure.size() != expected) {
    return refuse(Fault::kWrongSize, pressure.size(), " pressures for ", expected,
                  name.empty() ? " actuators (without names, all of the arm)" : " names",
                  "; send one pressure for each of ", basics::joined(arm.actuatorNames()),
                  ", or name the actuators");
  }
  std::vector<bool> seen(arm.actuatorCount(), false);
  for (std::size_t j = 0; j < pressure.size(); ++j) {
    const int i = name.empty() ? static_cast<int>(j) : indexOf(arm, name[j]);
    if (i < 0) {
      return refuse(Fault::kUnknownName, "no actuator is named '", basics::quoted(name[j]),
                    "'; the arm has ", basics::joined(arm.actuatorNames()));
    }
    const model::Actuator& actuator = arm.actuator(i);
    if (seen[i]) {
      return refuse(Fault::kDuplicateName, "'", actuator.name, "' is named twice; name it once");
    }
    seen[i] = true;
    if (!std::isfinite(pressure[j])) {
      return refuse(Fault::kNotFinite, "the pressure of ", actuator.name, " is ", pressure[j],
                    "; send a finite gauge pressure [Pa]");
    }
    const model::Range range = bounds(actuator.limits);
    if (!range.contains(pressure[j])) {
      return refuse(Fault::kOutOfRange, actuator.name, " is asked for ", pressure[j],
                    " Pa; stay within ", range.lower, " to ", range.upper, " Pa (gauge)");
    }
    wanted[i] = pressure[j];
  }
  return wanted;
}

std::string warningText(const std::string& what, double largest, const std::string& taker) {
  return basics::format(
      "all pressures of %s are at most %g Pa, which looks like kPa; %s gauge pressures in Pa, so "
      "200 kPa are 200000",
      what.c_str(), largest, taker.c_str());
}

}  // namespace

const char* whyLate(double age) {
  constexpr double kOtherClock = 600.0;  // [s]
  return age > kOtherClock ? "look for a recording, or for a machine whose clock differs"
                           : "see whether a computer is too busy, then synchronise the clocks";
}

const char* nameOf(Fault fault) { return kNames[static_cast<std::size_t>(fault)]; }

Checked<Eigen::VectorXd> checkPressures(const model::Arm& arm, const model::InputRef& command,
                                        const std::vector<std::string>& name,
                                        const std::vector<double>& pressure) {
  return assign(arm, command, name, pressure, [](const model::Range& limits) { return limits; });
}

Checked<Eigen::VectorXd> checkCommand(const model::Arm& arm, const model::InputRef& command,
                                      const std::vector<std::string>& name,
                                      const std::vector<double>& pressure) {
  return assign(arm, command, name, pressure, onTheWay);
}

std::optional<Refusal> checkAge(double age, double timeout, Timed what) {
  const char* const name = what == Timed::kTarget ? "the target" : "the reading";
  const char* const key =
      what == Timed::kTarget ? "safety.target_timeout_s" : "safety.reading_timeout_s";
  if (age < -timeout) {
    return refuse(Fault::kStale, name, " is stamped ", -age,
                  " s ahead of this machine's clock, more than ", timeout, " s (", key,
                  "); synchronise the clocks");
  }
  if (!(age > timeout)) return std::nullopt;
  return refuse(Fault::kStale, name, " is stamped ", age, " s ago, more than ", timeout, " s (",
                key, "); send fresh ones: ", whyLate(age));
}

Refusal restedRefusal(double pause) {
  return refuse(Fault::kRested,
                "somebody else has brought the arm to rest; send no target for more than ", pause,
                " s (safety.target_timeout_s), or call ~enable of pressure_command");
}

Checked<Eigen::VectorXd> checkReading(const model::Arm& arm, const std::vector<std::string>& name,
                                      const std::vector<double>& pressure) {
  if (!name.empty() && static_cast<int>(name.size()) < arm.actuatorCount()) {
    return refuse(Fault::kWrongSize, name.size(), " names for ", arm.actuatorCount(),
                  " actuators; send a reading of each of ", basics::joined(arm.actuatorNames()));
  }
  return assign(arm, Eigen::VectorXd::Zero(arm.actuatorCount()), name, pressure,
                [](const model::Range&) { return kPossibleReading; });
}

Checked<model::Twists> checkTwists(int sections, const std::vector<double>& twist) {
  const int expected = lie::SE3::kDof * sections;
  if (static_cast<int>(twist.size()) != expected) {
    return refuse(Fault::kWrongSize, twist.size(), " numbers for ", sections,
                  " sections; send 6 per section, [v; w], from the base on: ", expected);
  }
  for (std::size_t j = 0; j < twist.size(); ++j) {
    if (!std::isfinite(twist[j])) {
      return refuse(Fault::kNotFinite, "twist[", j, "] is ", twist[j],
                    "; send finite v [m] and w [rad]");
    }
    if (std::abs(twist[j]) > statics::kFarthestTarget) {
      return refuse(Fault::kOutOfRange, "twist[", j, "] is ", twist[j],
                    "; send v [m] and w [rad] of magnitude at most ", statics::kFarthestTarget);
    }
  }
  return model::Twists(Eigen::Map<const model::Twists>(twist.data(), lie::SE3::kDof, sections));
}

Checked<Eigen::Vector3d> checkPosition(const Eigen::Vector3d& position) {
  for (int axis = 0; axis < 3; ++axis) {
    if (!std::isfinite(position[axis])) {
      return refuse(Fault::kNotFinite, "the tip's ", "xyz"[axis], " is ", position[axis],
                    "; send a finite position [m]");
    }
    if (std::abs(position[axis]) > statics::kFarthestTarget) {
      return refuse(Fault::kOutOfRange, "the tip's ", "xyz"[axis], " is ", position[axis],
                    "; send a position in metres, in the frame of the arm's base");
    }
  }
  return position;
}

Checked<lie::SE3> checkPose(const Eigen::Vector3d& position, const Eigen::Quaterniond& rotation) {
  const Checked<Eigen::Vector3d> checked = checkPosition(position);
  if (const auto* refusal = std::get_if<Refusal>(&checked)) return *refusal;
  const double norm = rotation.norm();
  if (!std::isfinite(norm)) {
    return refuse(Fault::kNotFinite, "the tip's quaternion is not finite; send a unit quaternion");
  }
  if (std::abs(norm - 1.0) > kQuaternionTolerance) {
    return refuse(Fault::kNotUnitQuaternion, "the tip's quaternion has norm ", norm,
                  "; normalise it, or send mode POSITION to leave the orientation free");
  }
  return lie::SE3{rotation.normalized().toRotationMatrix(), position};
}

void UnitWatch::note(double now, const std::string& commander, double largest) {
  if (!(largest > 0)) return;
  auto found = records_.find(commander);
  if (found == records_.end()) {
    if (records_.size() >= kMost) return;
    found = records_.emplace(commander, Record{now, 0, false}).first;
  }
  Record& record = found->second;
  record.largest = std::max(record.largest, largest);
  if (record.largest >= kSuspicious) record.settled = true;
}

std::string UnitWatch::warning(double now) {
  for (auto& [commander, record] : records_) {
    if (record.settled || now - record.since < kPatience) continue;
    record.settled = true;
    return warningText(basics::quoted(commander), record.largest, "pressure_target takes");
  }
  return {};
}

std::string kilopascalWarning(const std::string& what, const model::Arm& arm,
                              const Eigen::Ref<const Eigen::MatrixXd>& inputs) {
  double largest = 0;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    if (!model::isPressure(arm.actuator(i).drive)) continue;
    for (const double pressure : inputs.col(i)) {
      if (!(pressure >= 0 && pressure < UnitWatch::kSuspicious)) return {};
      largest = std::max(largest, pressure);
    }
  }
  return largest > 0 ? warningText(what, largest, "expected") : std::string();
}

}  // namespace helix_arm::control
