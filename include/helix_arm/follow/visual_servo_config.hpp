#pragma once

#include <optional>

#include "helix_arm/estimation/arm_filter_options.hpp"
#include "helix_arm/estimation/load_forks_options.hpp"
#include "helix_arm/estimation/placed_view.hpp"
#include "helix_arm/follow/on_contact.hpp"

namespace helix_arm::follow {

/// Rules of a VisualServo.
struct VisualServoConfig {
  /// Of the filter that the control uses.
  estimation::ArmFilterOptions filter;
  /// Creep of the filter that watches for loads, which must not swallow them [s^-1/2].
  double watch_creep = 0.05;
  /// Time constant with which the control takes over what the filter learns, > 0 [s]. Must exceed
  /// the rule of smoothingFor() if the arm vibrates.
  double smoothing = 0.2;
  double stale_after = 0.3;  ///< without a picture the loop coasts, > 0 [s]
  double coast_time = 3.0;   ///< then it is open, > 0 [s]
  double time_constant;      ///< of the regulator's lag, > 0 [s]
  double reading_noise;      ///< standard deviation of a pressure reading, > 0 [Pa]
  /// How the arm is seen, for its error budget and its loads; nothing: placements count as exact,
  /// and shapes as the mean of the strain.
  std::optional<estimation::PlacedView> placed = {};
  estimation::LoadForksOptions contact;       ///< what counts as contact
  OnContact on_contact = OnContact::kReport;  ///< may change with each target

  /// Of the filter that watches for loads.
  estimation::ArmFilterOptions watchFilter() const;
  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// Least smoothing time with which an arm that vibrates at `frequency` [Hz] with a damping ratio
/// stays stable behind a regulator with this lag [s].
double smoothingFor(double frequency, double damping, double time_constant);

}  // namespace helix_arm::follow
