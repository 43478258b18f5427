#include "helix_arm/follow/visual_servo_config.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "helix_arm/basics/pi.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/follow/visual_servo.hpp"

namespace helix_arm::follow {
namespace {

constexpr char kCulprit[] = "visual servo";

}  // namespace

const char* nameOf(LoopState state) {
  static constexpr std::array<const char*, kLoopStateCount> kNames = {
      "idle", "open", "closed", "coasting", "yielding", "diverging", "doubtful"};
  return kNames[static_cast<std::size_t>(state)];
}

estimation::ArmFilterOptions VisualServoConfig::watchFilter() const {
  estimation::ArmFilterOptions out = filter;
  out.creep = watch_creep;
  return out;
}

void VisualServoConfig::validate() const {
  filter.validate();
  contact.validate();
  if (placed) placed->validate();
  basics::requirePositive(kCulprit, {{"the smoothing time [s]", smoothing},
                                     {"the time after which it coasts [s]", stale_after},
                                     {"the time for which it coasts [s]", coast_time},
                                     {"the regulator's time constant [s]", time_constant},
                                     {"the noise of a reading [Pa]", reading_noise}});
  basics::requireNotNegative(kCulprit, "the creep of the watch [s^-1/2]", watch_creep);
}

double smoothingFor(double frequency, double damping, double time_constant) {
  const double turn = 2 * basics::kPi * frequency;
  const double lagged = turn * time_constant;
  const double gain2 = 1 / (damping * damping) / (1 + lagged * lagged);
  return std::sqrt(std::max(0.0, gain2 - 1)) / turn;
}

}  // namespace helix_arm::follow
