#include "follow_reader.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "helix_arm/basics/pi.hpp"
#include "helix_arm/io/number.hpp"
#include "pose_reader.hpp"

namespace helix_arm::io {
namespace {

const NumberRule kTime = within(kPositive, 1e-3, 3600, " s");
const NumberRule kMode = within(kPositive, 0.01, 1000, " Hz");
const NumberRule kDamping = within(kPositive, 1e-3, 1);
const NumberRule kPart = within(kNotNegative, 0, 1);
const NumberRule kCreep = within(kNotNegative, 0, 100, " per square root of a second");
const NumberRule kBiasTranslation = within(kPositive, 1e-6, 1, " m");
const NumberRule kBiasRotation = within(kPositive, 1e-4, 180, " degrees");
const NumberRule kContactLimit = within(kPositive, 1, 1e6);
const NumberRule kReadingNoise = within(kPositive, 1e-3, 100, " kPa");

constexpr double kUsualDamping = 0.1;        // of muscles and bellows
constexpr double kHardwareNoise = 2e3;       // [Pa]
constexpr double kLeastReadingNoise = 10.0;  // of a simulated regulator without noise [Pa]
constexpr double kWatchedCreep = 0.1;  // relative to the creep, in the filter that detects loads

double usualNoise(const std::optional<regulator::Config>& regulator) {
  const auto* simulated =
      regulator ? std::get_if<regulator::SimulatedRegulatorConfig>(&*regulator) : nullptr;
  return simulated != nullptr ? std::max(simulated->noise, kLeastReadingNoise) : kHardwareNoise;
}

// Times derived from the arm's vibration; a given smoothing time must be long enough.
void readVibration(const MapReader& keys, follow::VisualServoConfig& loop) {
  const auto given = keys.optionalNumber("smoothing_s", kTime);
  loop.smoothing = given.value_or(loop.smoothing);
  const double damping = keys.number("mode_damping", kDamping, kUsualDamping);
  if (!keys.has("mode_hz")) {
    if (keys.has("mode_damping")) {
      keys.complain("mode_damping", "is given without mode_hz; expected both or none");
    }
    return;
  }
  const auto frequency = keys.optionalNumber("mode_hz", kMode);
  if (!frequency) return;
  loop.filter.settling_time = 1 / (2 * basics::kPi * *frequency * damping);
  const double least = follow::smoothingFor(*frequency, damping, loop.time_constant);
  if (given && *given < least) {
    keys.fault("smoothing_s", "at least " + formatNumber(std::ceil(100 * least) / 100) +
                                  " s, or the loop excites an arm with this mode_hz and "
                                  "mode_damping; leave out smoothing_s to use that value");
  }
  loop.smoothing = std::max(loop.smoothing, least);
}

void readFilter(const MapReader& keys, follow::VisualServoConfig& loop) {
  estimation::ArmFilterOptions& filter = loop.filter;
  filter.hysteresis = keys.number("hysteresis", kPart, filter.hysteresis);
  if (const auto creep = keys.optionalNumber("creep", kCreep)) {
    filter.creep = *creep;
    loop.watch_creep = kWatchedCreep * *creep;
  }
  filter.bias_translation =
      keys.number("bias_translation_m", kBiasTranslation, filter.bias_translation);
  if (const auto deg = keys.optionalNumber("bias_rotation_deg", kBiasRotation)) {
    filter.bias_rotation = radians(*deg);
  }
  if (const auto kpa = keys.optionalNumber("reading_noise_kpa", kReadingNoise)) {
    loop.reading_noise = pascals(*kpa);
  }
}

void readContact(const MapReader& keys, follow::VisualServoConfig& loop) {
  loop.contact.limit = keys.number("contact_limit", kContactLimit, loop.contact.limit);
  if (!keys.has("on_contact")) return;
  std::vector<std::string> words;
  for (const follow::OnContact reaction : follow::kContactReactions) {
    words.emplace_back(nameOf(reaction));
  }
  const auto word = keys.choice("on_contact", words);
  for (const follow::OnContact reaction : follow::kContactReactions) {
    if (word == nameOf(reaction)) loop.on_contact = reaction;
  }
}

}  // namespace

follow::VisualServoConfig readFollow(const MapReader& scene, const Value& document,
                                     const SafetyConfig& safety,
                                     const std::optional<regulator::Config>& regulator,
                                     FaultList& faults) {
  follow::VisualServoConfig loop{};
  loop.time_constant = safety.rules.time_constant;
  loop.reading_noise = usualNoise(regulator);
  const bool hardware = regulator && regulator::isHardware(*regulator);
  if (hardware) loop.on_contact = follow::OnContact::kYield;
  const Value* value = document.find("follow");
  if (value == nullptr) return loop;
  const MapReader keys(*value, scene.path("follow"),
                       {"smoothing_s", "mode_hz", "mode_damping", "stale_s", "coast_s",
                        "hysteresis", "creep", "bias_translation_m", "bias_rotation_deg",
                        "on_contact", "contact_limit", "reading_noise_kpa"},
                       faults);
  readVibration(keys, loop);
  loop.stale_after = keys.number("stale_s", kTime, loop.stale_after);
  loop.coast_time = keys.number("coast_s", kTime, loop.coast_time);
  readFilter(keys, loop);
  readContact(keys, loop);
  return loop;
}

}  // namespace helix_arm::io
