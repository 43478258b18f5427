#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/calibration/contraction_fit.hpp"
#include "helix_arm/model/actuator.hpp"

/// Muscles or bellows on a testing machine: force against length and pressure.
namespace helix_arm::estimation {

/// A reading of equal muscles in parallel.
struct StandReading {
  double pressure;  ///< gauge [Pa]
  double length;    ///< of each [m]
  double force;     ///< of all, tension is positive [N]
};

/// Readings in the order taken.
struct StandRun {
  std::string name;
  std::vector<StandReading> readings;
};

/// The law of one muscle: F = K_eps(p) (x - l(p)) / l_0, where l_0 is the free length at the lower
/// end of the curve l(p).
struct StandLaw {
  model::Contraction contraction;
  double K_eps;                 ///< least [N]
  model::StiffnessTable table;  ///< factors on it

  /// [N]; a pressure beyond the curve counts as its end [Pa].
  double force(double pressure, double length) const;
};

/// Readings against a law.
struct StandComparison {
  Eigen::VectorXd residual;  ///< (readings) law - reading [N]
  double rms = 0.0;          ///< [N]
  double span = 0.0;         ///< of the measured forces [N]
  /// Width of the loop: the median residual of readings to which the pressure rose beyond that of
  /// those to which it fell [N]. Absent if it only rose or fell.
  std::optional<double> loop;
  int beyond = 0;  ///< readings at pressures beyond the curve
};
StandComparison compareStand(const StandLaw& law, const StandRun& run,
                             int muscles);  ///< of parallel ones

/// A law with its errors.
struct StandFit {
  std::string reason;  ///< cause and remedy; empty if fitted
  ContractionFit contraction;
  std::optional<StandLaw> law;  ///< if fitted
  // At the knots of the contraction's spline and the table.
  std::vector<double> pressures;               ///< ascending [Pa]
  Eigen::VectorXd lengths, K_eps;              ///< [m], [N]
  Eigen::VectorXd lengths_error, K_eps_error;  ///< standard errors, for correlated residuals
  double rms = 0.0;                            ///< of all readings [N]
  std::vector<std::pair<std::string, double>> held_out;  ///< RMS of each part, without it [N]
  double held_out_rms = 0.0;                             ///< over all parts [N]
};

/// Least squares of the force over the free lengths (a natural spline) and K_eps (linear between
/// the same pressures) at up to 7 pressures, from 0, or the least one, to the largest. Negative
/// pressures within 1 % of the largest count as 0.
///
/// Held out are the runs; of a single one each tenth of its rows.
/// @param muscles  in parallel, >= 1.
StandFit fitStand(const std::vector<StandRun>& runs, int muscles);

}  // namespace helix_arm::estimation
