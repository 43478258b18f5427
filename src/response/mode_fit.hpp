#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "helix_arm/model/arm_response.hpp"
#include "response_fit.hpp"

/// The slowest vibration of an arm, from a point that rings after a release or a step.
namespace helix_arm::estimation {

/// One release or step.
struct RingDown {
  int trial = 0;                 ///< that it belongs to, counted from 0
  double begin = 0.0;            ///< time of the fastest motion [s]
  std::string reason;            ///< why no mode was found; empty if one was
  Estimate frequency = {};       ///< natural frequency [Hz]
  Estimate damping = {};         ///< damping ratio
  double rms = 0.0;              ///< of the distance of the positions from the fitted motion [m]
  int rows = 0;                  ///< that were fitted
  double slow = 0.0;             ///< time constant of the slow part [s]
  std::vector<Eigen::Index> at;  ///< (rows) places of these rows in the recording
  Eigen::MatrixXd position;      ///< (rows x 1 to 3) that were fitted [m]
  Eigen::VectorXd input;         ///< (n) where it ends [Pa]; empty where none is known

  bool found() const { return reason.empty(); }
};

/// A mode that all releases and steps have in common.
struct ModeFit {
  std::string failure;  ///< why there is none; empty if there is one
  Estimate frequency;   ///< natural frequency [Hz]
  Estimate damping;     ///< damping ratio
  double rms = 0.0;     ///< of all rows that were fitted [m]
  std::vector<RingDown> rings;

  bool fitted() const { return failure.empty(); }
};

/// Mean of values that differ by more than their errors (DerSimonian and Laird, 1986); weights
/// count with a few percent of scatter between them, errors with the scatter that is seen.
/// @param values  at least one.
Estimate pooled(const std::vector<Estimate>& values);

/// Fits frequency f and damping ratio zeta to positions x(t) of one point of an arm in any frame,
///
///     x = c + d exp(-t / T) + exp(-zeta w t) (a cos(w_d t) + b sin(w_d t)),
///     w = 2 pi f,  w_d = w sqrt(1 - zeta^2),
///
/// where the slow part stands for creep and for what is left of the drive, and f, zeta and T are
/// common to all coordinates (variable projection; f starts from a grid of 0.3 Hz to a third of the
/// rate of the rows). The fit begins most of a period after the fastest motion, or earlier if the
/// arm is strongly damped, and ends when the ringing has died away.
///
/// Every change of a pressure by a fifth of the largest range is a step. A trial in which no
/// pressure changes so far, or none is known, is taken from the last of its fast motions.
///
/// No mode is found where a sum of two exponentials explains the motion as well, as of an
/// overdamped arm, or where a standard error exceeds half of its value. Standard errors count
/// residuals that are correlated in time as fewer. The common values are
/// pooled().
///
/// @param history   times are required; input (rows x actuators, or x 0 where none is known).
/// @param position  (rows x 1 to 3) [m]; NaN where there is no reading.
/// @throws std::invalid_argument without times, or if sizes differ.
ModeFit fitMode(const model::InputHistory& history, const Eigen::MatrixXd& position);

/// The ringing of a simulated arm in place of the one that `ring` was fitted to, by the same rows.
/// Errors are those of the difference from `ring`: what a fitted motion leaves of a swing that is
/// large is alike in both.
/// @param ring  with a mode. @param position  (rows x 3) [m].
/// @throws std::invalid_argument otherwise.
RingDown refitted(const RingDown& ring, const model::InputHistory& history,
                  const Eigen::MatrixXd& position);

}  // namespace helix_arm::estimation
