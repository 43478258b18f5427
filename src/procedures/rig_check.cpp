#include "helix_arm/procedures/rig_check.hpp"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <sstream>
#include <variant>

#include "helix_arm/regulator/config.hpp"
#include "rig_check_parts.hpp"

namespace helix_arm::procedures {
namespace {

// Parts of a curve's range and length.
constexpr double kLeastStroke = 0.03;
constexpr double kLeastOfRange = 0.5;
// Slope relative to its mean, below which pressure hardly moves a muscle; and the part of the range
// that may be so.
constexpr double kFlat = 0.1;
constexpr double kMostFlat = 0.2;
constexpr int kCurveSteps = 200;

std::string kpa(double pascals) { return figure(pascals / 1e3, 4) + " kPa"; }

const model::Actuator& highest(const model::Arm& arm) {
  int best = 0;
  for (int i = 1; i < arm.actuatorCount(); ++i) {
    if (arm.actuator(i).limits.upper > arm.actuator(best).limits.upper) best = i;
  }
  return arm.actuator(best);
}

// What a profile tells of its device, against the channels and limits of the arm.
template <class Profile>
void checkDevice(const io::Scene& scene, const Profile& profile, int channels,
                 std::vector<Finding>& findings) {
  const model::Actuator& most = highest(scene.arm);
  const std::string name = regulator::describe(*scene.regulator);
  if (profile.highestPressure() < most.limits.upper) {
    findings.push_back({Severity::kFault, "device_range", name,
                        "it accepts at most " + kpa(profile.highestPressure()) +
                            ", and the limit of " + most.name + " is " + kpa(most.limits.upper),
                        "lower max_pressure_kpa to what the device can give; if yours gives more, "
                        "name a copy of its profile that says so"});
  }
  if (profile.channels && channels > *profile.channels) {
    findings.push_back({Severity::kFault, "device_channels", name,
                        "it has at most " + std::to_string(*profile.channels) +
                            " channels, and the arm needs " + std::to_string(channels),
                        "use a device with more channels, or fewer muscles; if yours has more, "
                        "name a copy of its profile that says so"});
  }
}

void checkWatchdog(const io::Scene& scene, std::vector<Finding>& findings) {
  const auto* serial = std::get_if<regulator::SerialConfig>(&*scene.regulator);
  const std::string name = regulator::describe(*scene.regulator);
  if (serial != nullptr && std::isfinite(serial->profile.watchdog)) {
    findings.push_back(
        {Severity::kNote, "watchdog", name,
         "it vents by itself " + figure(serial->profile.watchdog) + " s after the last line",
         "pull the line once with little pressure, and see that it does"});
    return;
  }
  findings.push_back(
      {Severity::kWarning, "no_watchdog", name,
       "its profile promises no venting when the line or this computer dies; expected a watchdog "
       "of the device",
       "mount a dump valve that opens without power, and a relief valve; see docs/safety.md"});
}

}  // namespace

const char* nameOf(Severity severity) {
  switch (severity) {
    case Severity::kNote:
      return "note";
    case Severity::kWarning:
      return "warning";
    case Severity::kFault:
      break;
  }
  return "fault";
}

void sortBySeverity(std::vector<Finding>& findings) {
  std::stable_sort(findings.begin(), findings.end(),
                   [](const Finding& a, const Finding& b) { return a.severity > b.severity; });
}

std::string figure(double value, int digits) {
  std::ostringstream text;
  text << std::setprecision(digits) << value;
  return text.str();
}

bool RigCheck::hasFault() const {
  return std::any_of(findings.begin(), findings.end(),
                     [](const Finding& finding) { return finding.severity == Severity::kFault; });
}

void checkCurves(const io::Scene& scene, std::vector<Finding>& findings) {
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    const model::Actuator& actuator = scene.arm.actuator(i);
    const model::Range& limits = actuator.limits;
    const model::Range& curve = actuator.contraction.inputRange();
    const double range = limits.upper - limits.lower, whole = curve.upper - curve.lower;
    const double change =
        actuator.contraction.length(limits.upper) - actuator.contraction.length(limits.lower);
    const double stroke = std::abs(change) / actuator.contraction.length(limits.lower);
    if (stroke < kLeastStroke) {
      findings.push_back({Severity::kWarning, "short_stroke", actuator.name,
                          "its length changes by " + figure(100 * stroke) +
                              " % within its limits; expected 3 % or more",
                          "raise max_pressure_kpa, or measure the contraction curve again"});
    }
    if (range < kLeastOfRange * whole) {
      findings.push_back(
          {Severity::kNote, "curve_unused", actuator.name,
           "its limits use " + figure(100 * range / whole) + " % of its contraction curve",
           "raise max_pressure_kpa if the muscle stands it"});
    }
    int flat = 0;
    for (int k = 0; k <= kCurveSteps; ++k) {
      const double q =
          std::clamp(limits.lower + range * k / kCurveSteps, limits.lower, limits.upper);
      flat += std::abs(actuator.contraction.slope(q)) < kFlat * std::abs(change) / range ? 1 : 0;
    }
    const double part = static_cast<double>(flat) / (kCurveSteps + 1);
    if (part > kMostFlat) {
      findings.push_back({Severity::kWarning, "flat_curve", actuator.name,
                          "in " + figure(100 * part, 2) +
                              " % of its limits its length hardly changes (less than a tenth of "
                              "the mean slope); expected 20 % at most",
                          "raise min_pressure_kpa, or lower max_pressure_kpa, to leave that out"});
    }
  }
}

void checkRegulator(const io::Scene& scene, std::vector<Finding>& findings) {
  if (!scene.regulator) {
    findings.push_back({Severity::kNote, "no_regulator", "regulator",
                        "scene " + scene.name + " has none, so that nothing moves",
                        "add the section regulator"});
    return;
  }
  const model::Actuator& most = highest(scene.arm);
  if (const auto* simulated = std::get_if<regulator::SimulatedRegulatorConfig>(&*scene.regulator)) {
    for (const Finding& finding : checkSupply(scene, simulated->supply_pressure)) {
      findings.push_back(finding);
    }
    return;
  }
  if (const auto* serial = std::get_if<regulator::SerialConfig>(&*scene.regulator)) {
    checkDevice(scene, serial->profile, scene.arm.actuatorCount(), findings);
  }
  if (const auto* modbus = std::get_if<regulator::ModbusConfig>(&*scene.regulator)) {
    const std::vector<int>& slots = modbus->slots;
    const int last = slots.empty() ? 0 : *std::max_element(slots.begin(), slots.end());
    checkDevice(scene, modbus->profile, last + 1, findings);
  }
  const auto& least_supply = scene.safety.rules.min_supply;
  if (least_supply && *least_supply < most.limits.upper) {
    findings.push_back({Severity::kWarning, "min_supply", "safety.min_supply_kpa",
                        "it is " + kpa(*least_supply) + ", below the limit of " + most.name + ", " +
                            kpa(most.limits.upper) +
                            ": a supply between both leaves set points unreached",
                        "raise it to the highest limit, or lower the limits"});
  }
  checkWatchdog(scene, findings);
}

std::vector<Finding> checkSupply(const io::Scene& scene, double supply) {
  const model::Actuator& most = highest(scene.arm);
  if (supply >= most.limits.upper) return {};
  return {{Severity::kWarning, "supply", most.name,
           "its limit is " + kpa(most.limits.upper) + ", and the supply gives " + kpa(supply) +
               ": pressures above that are never reached",
           "raise the supply, or lower max_pressure_kpa"}};
}

RigCheck checkRig(const io::Scene& scene, int samples) {
  RigCheck check;
  checkTags(scene, check.findings);
  checkCamera(scene, check.findings);
  check.vision = checkVision(scene, samples, check.findings);
  checkCurves(scene, check.findings);
  checkRegulator(scene, check.findings);
  sortBySeverity(check.findings);
  return check;
}

}  // namespace helix_arm::procedures
