#pragma once

#include <cstdint>
#include <optional>

#include "helix_arm/localization/placed_view.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "helix_arm/tracking/mode_estimator.hpp"
#include "helix_arm/tracking/tracking_options.hpp"

namespace helix_arm::follow {

/// Reaction of the loop while something touches the arm.
enum class OnContact : std::uint8_t {
  kReport,  ///< goes on: a payload is carried
  kYield,   ///< correction and path stand still, so that the force does not grow
  kStop,    ///< gives the path up and holds the command
};
/// All reactions. Add a new one here, too.
inline constexpr OnContact kContactReactions[] = {OnContact::kReport, OnContact::kYield,
                                                  OnContact::kStop};

/// "report", "yield" or "stop".
constexpr const char* nameOf(OnContact reaction) {
  switch (reaction) {
    case OnContact::kYield:
      return "yield";
    case OnContact::kStop:
      return "stop";
    case OnContact::kReport:
      break;
  }
  return "report";
}

/// Rules of a VisualServo.
struct VisualServoConfig {
  /// Options of the filter that the control uses.
  estimation::ArmFilterOptions filter;
  /// Creep of the filter that watches for loads, which must not swallow them [s^-1/2].
  double watch_creep = 0.05;
  /// Time constant with which the control takes over what the filter learns, > 0 [s]. Must exceed
  /// the rule of smoothingFor() if the arm vibrates.
  double smoothing = 0.2;
  std::optional<estimation::Mode> mode = {};  ///< told; pictures may show another
  double stale_after = 0.3;                   ///< without a picture the loop coasts, > 0 [s]
  double coast_time = 3.0;                    ///< then it is open, > 0 [s]
  double time_constant;                       ///< of the regulator's lag, > 0 [s]
  double slew = 1e6;                          ///< at which set points change, > 0 [Pa/s]
  double reading_noise;  ///< standard deviation of a pressure reading, > 0 [Pa]
  /// Preference among the pressures of redundant actuators, while the target moves or the
  /// correction changes: kMinChange, or kMinPressure, which may jump. Each new target begins at the
  /// lowest pressures.
  statics::Preference preference = statics::Preference::kMinChange;
  /// How the arm is seen, for its error budget and its loads; nothing: placements count as exact,
  /// and shapes as the mean of the strain.
  std::optional<estimation::PlacedView> placed = {};
  estimation::OnsetOptions contact;           ///< what counts as contact
  OnContact on_contact = OnContact::kReport;  ///< may change with each target
  /// A yielding arm that is seen to be touched for longer takes the load as its own, > 0 [s].
  double yield_timeout = 30.0;

  /// Options of the filter that watches for loads.
  estimation::ArmFilterOptions watchFilter() const;
  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// Least smoothing time with which the loop over an arm that vibrates at `frequency` [Hz] with a
/// damping ratio, behind a regulator with this lag and pictures 0.1 s late, keeps 0.4 from -1 in
/// Nyquist's plane, whether the arm moves by half or by one and a half times what the model says
/// [s].
double smoothingFor(double frequency, double damping, double time_constant);

}  // namespace helix_arm::follow
