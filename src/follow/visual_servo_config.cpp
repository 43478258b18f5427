#include "helix_arm/follow/visual_servo_config.hpp"

#include <array>
#include <cmath>
#include <complex>

#include "basics/pi.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/follow/visual_servo.hpp"

namespace helix_arm::follow {
namespace {

constexpr char kCulprit[] = "visual servo";
// Constants of smoothingFor(): least distance of the open loop from -1, delay of the pictures [s],
// bounds and steps of what is searched.
constexpr double kMargin = 0.4, kLatency = 0.1;
constexpr double kShortestSmoothing = 0.01, kLongestSmoothing = 10.0, kSmoothingStep = 1.05;  // [s]
constexpr double kLowest = 0.02, kHighest = 20.0, kFrequencyStep = 1.01;  // of the mode's frequency

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
                                     {"the time for which it yields [s]", yield_timeout},
                                     {"the regulator's time constant [s]", time_constant},
                                     {"the noise of a reading [Pa]", reading_noise}});
  basics::requireNotNegative(kCulprit, "the creep of the watch [s^-1/2]", watch_creep);
  basics::require(preference == statics::Preference::kMinChange ||
                      preference == statics::Preference::kMinPressure,
                  kCulprit, ": expected the preference kMinChange or kMinPressure");
}

double smoothingFor(double frequency, double damping, double time_constant) {
  using Complex = std::complex<double>;
  const double turn = 2 * basics::kPi * frequency;
  // Open loop L of the correction at an angular frequency w: the difference of arm and model,
  // (gain * mode - 1), behind regulator, latency and smoothing.
  const auto isStable = [&](double smoothing) {
    for (double w = kLowest * turn; w < kHighest * turn; w *= kFrequencyStep) {
      const Complex s(0, w);
      const Complex mode = turn * turn / (s * s + 2 * damping * turn * s + turn * turn);
      const Complex path =
          std::exp(-kLatency * s) / ((1.0 + s * time_constant) * (1.0 + s * smoothing));
      for (const double gain : {0.5, 1.0, 1.5}) {
        if (std::abs(1.0 + path * (gain * mode - 1.0)) < kMargin) return false;
      }
    }
    return true;
  };
  // L of a long smoothing encircles nothing, and stays away from -1 on the way to a shorter one.
  double smoothing = kLongestSmoothing;
  while (smoothing > kShortestSmoothing && isStable(smoothing / kSmoothingStep)) {
    smoothing /= kSmoothingStep;
  }
  return smoothing;
}

}  // namespace helix_arm::follow
