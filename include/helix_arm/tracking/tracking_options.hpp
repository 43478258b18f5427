#pragma once

#include <Eigen/Core>

#include "helix_arm/model/actuator.hpp"

namespace helix_arm::estimation {

/// Assumptions of an ArmFilter. The defaults are those of a McKibben arm with a webcam.
struct ArmFilterOptions {
  /// Part of a motion that hysteresis may leave behind, >= 0.
  double hysteresis = 0.2;
  /// Creep of the bias, in its standard deviations per square root of a second, >= 0 [s^-1/2].
  double creep = 0.5;
  double bias_translation = 0.002;  ///< standard deviation of the bias, each entry of v, > 0 [m]
  double bias_rotation = 0.03;      ///< of each entry of w, > 0 [rad]
  /// Time in which a vibration of the arm dies out, 1 / (2 pi f zeta), > 0 [s].
  double settling_time = 0.3;
  /// Standard deviations of the logarithms of the stiffness ratios, > 0.
  model::Stiffness stiffness_deviation = {0.3, 0.3, 0.3};
  double K_eps_deviation = 0.3;  ///< likewise of K_eps
  /// Correlation of these logarithms, in the order K_gamma, K_kappa, K_tau, K_eps: positive
  /// definite.
  Eigen::Matrix4d stiffness_correlation = Eigen::Matrix4d::Identity();
  double length_deviation = 0.02;  ///< likewise of each length scale
  double stroke_deviation = 0.05;  ///< likewise of the stroke of each actuator; 0: it is known
  bool planar = false;             ///< measurements hold v_z, w_x and w_y at 0

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// Assumptions of OnsetHypotheses. Forces are those on an arm of TipCompliance::kTypicalStiffness;
/// on another they are in proportion to its K_eps.
struct OnsetOptions {
  /// Score beyond which something touches the arm, > 0. A lower one finds lighter contacts, and
  /// more that are none.
  double limit = 32.0;
  double deviation = 1.0;  ///< standard deviation of each entry of a force, > 0 [N]
  double creep = 0.05;     ///< of the force, >= 0 [N s^-1/2]

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

}  // namespace helix_arm::estimation
