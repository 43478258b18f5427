#include "ros_bridge/pressure/pressure_diagnostics.hpp"

#include "helix_arm/regulator/config.hpp"
#include "ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

using control::SafetyCause;
using control::SafetyState;
using diagnostic_msgs::DiagnosticStatus;

constexpr double kSlowShare = 0.9;  // of ~rate; a slower loop is worth a warning

const char* textOf(control::Valve valve) {
  switch (valve) {
    case control::Valve::kRegulate:
      return "regulate";
    case control::Valve::kClose:
      return "close";
    case control::Valve::kVent:
      return "vent";
  }
  return "";
}

unsigned char diagnosticLevel(const control::SafetyReport& report) {
  if (report.vent_overdue) return DiagnosticStatus::ERROR;
  if (report.cause == SafetyCause::kNone) return DiagnosticStatus::OK;
  if (report.cause == SafetyCause::kVentRequested) return DiagnosticStatus::WARN;
  return report.state == SafetyState::kEnabled ? DiagnosticStatus::OK : DiagnosticStatus::ERROR;
}

DiagnosticStatus safetyStatus(const std::string& node, const io::Scene& scene,
                              const PressureLoop::Snapshot& path) {
  DiagnosticStatus out;
  out.name = statusName(node, names::kSafetyStatus);
  out.level = diagnosticLevel(path.report);
  out.message = path.reason;
  addValue(out, "state", nameOf(path.report.state));
  addValue(out, "cause", nameOf(path.report.cause));
  addValue(out, "emergency_stop", path.report.stopped ? "engaged" : "released");
  addValue(out, "vent_overdue", path.report.vent_overdue ? "true" : "false");
  addValue(out, names::kTargetTimeoutKey, fixed(scene.safety.rules.target_timeout, 3));
  return out;
}

DiagnosticStatus regulatorStatus(const std::string& node, const io::Scene& scene,
                                 const regulator::IoStatus& io) {
  DiagnosticStatus out;
  out.name = statusName(node, names::kRegulatorStatus);
  out.level = io.up ? DiagnosticStatus::OK : DiagnosticStatus::ERROR;
  out.message = io.up ? "the regulator answers" : "no link to the regulator: " + io.last_error;
  addValue(out, "regulator", regulator::describe(*scene.regulator));
  addValue(out, "writes", std::to_string(io.writes));
  addValue(out, "reads", std::to_string(io.reads));
  addValue(out, "bad_replies", std::to_string(io.bad_replies));
  addValue(out, "connections", std::to_string(io.connections));
  addValue(out, "breaks", std::to_string(io.breaks));
  addValue(out, "own_vents", std::to_string(io.own_vents));
  addValue(out, "last_error", io.last_error);
  return out;
}

DiagnosticStatus channelStatus(const std::string& node, const io::Scene& scene,
                               const PressureLoop::Snapshot& path, int channel) {
  const model::Actuator& actuator = scene.arm.actuator(channel);
  const bool culprit = path.report.channel == channel;
  DiagnosticStatus out;
  out.name = statusName(node, names::kChannelStatus + actuator.name);
  if (culprit) out.level = diagnosticLevel(path.report);
  const control::Valve valve = path.orders.valve[static_cast<std::size_t>(channel)];
  out.message = culprit ? path.reason : textOf(valve);
  const auto kpa = [](double pascals) { return fixed(1e-3 * pascals); };
  addValue(out, "valve", textOf(valve));
  addValue(out, "set_point_kpa", kpa(path.orders.set_point[channel]));
  addValue(out, "target_kpa", kpa(path.goal[channel]));
  addValue(out, "measured_kpa", kpa(path.reading[channel]));
  // Rounded to 0.1 kPa, a limit would let through what the arm refuses.
  addValue(out, names::kLowerLimitKey, fixed(1e-3 * actuator.limits.lower, 4));
  addValue(out, names::kUpperLimitKey, fixed(1e-3 * actuator.limits.upper, 4));
  return out;
}

}  // namespace

std::vector<DiagnosticStatus> pressureStatuses(const std::string& node, const io::Scene& scene,
                                               const PressureLoop::Snapshot& path) {
  std::vector<DiagnosticStatus> out = {safetyStatus(node, scene, path)};
  if (path.io) out.push_back(regulatorStatus(node, scene, *path.io));
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    out.push_back(channelStatus(node, scene, path, i));
  }
  return out;
}

DiagnosticStatus LoopRate::status(const std::string& node, const PressureLoop::Snapshot& path,
                                  const ros::SteadyTime& now) {
  const double rate = static_cast<double>(path.turns - turns_) / (now - last_look_).toSec();
  last_look_ = now;
  turns_ = path.turns;
  const bool slow = rate < kSlowShare * wanted_;
  DiagnosticStatus out;
  out.name = statusName(node, names::kLoopStatus);
  out.level = slow ? DiagnosticStatus::WARN : DiagnosticStatus::OK;
  out.message = slow ? "the loop is slower than ~rate" : "the loop keeps its rate";
  addValue(out, names::kRateKey, fixed(rate));
  addValue(out, names::kWantedRateKey, fixed(wanted_));
  addValue(out, names::kBadReadingsKey, std::to_string(path.bad_readings.total()));
  return out;
}

}  // namespace helix_arm::ros_bridge
