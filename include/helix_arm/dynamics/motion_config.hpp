#pragma once

#include <optional>

namespace helix_arm::dynamics {

/// Highest degree of the strain's polynomials.
inline constexpr int kMostOrder = 4;

/// Time constants of Kelvin-Voigt damping, the stress of a strain rate over that of the strain, >=
/// 0 [s].
struct StrainTimes {
  double stretch = 0.0, shear = 0.0, twist = 0.0, bend = 0.0;
};

/// Properties of an arm that its motion takes besides its statics.
struct MotionConfig {
  StrainTimes damping;
  /// Radius of inertia r of a section about its axis, > 0 [m]; by default the mean distance of its
  /// actuators from the axis.
  std::optional<double> inertia_radius;
  int order = 0;         ///< degree of the strain's polynomials in a section, 0 .. kMostOrder
  double step = 0.0025;  ///< longest step of time, > 0 [s]

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// A vibration of an arm.
struct Vibration {
  double frequency = 0.0;  ///< natural [Hz]
  double damping = 0.0;    ///< ratio, < 1
};

}  // namespace helix_arm::dynamics
