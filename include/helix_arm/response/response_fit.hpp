#pragma once

#include <Eigen/Core>
#include <array>
#include <string>

#include "helix_arm/model/arm_response.hpp"

namespace helix_arm::estimation {

/// What was found of a part of a response.
enum class ResponseVerdict {
  kFound,
  kNone,           ///< the data determine it to be none: within two standard errors of 0
  kNotDetermined,  ///< the data cannot tell
};

/// A number with its standard error.
struct Estimate {
  double value = 0.0;
  double standard_error = 0.0;
};

/// A fitted response, the same for all actuators.
struct ResponseFit {
  std::string failure;  ///< why nothing could be fitted; empty if it could
  ResponseVerdict lag = ResponseVerdict::kNotDetermined;
  ResponseVerdict play = ResponseVerdict::kNotDetermined;
  std::string lag_reason, play_reason;  ///< of a verdict other than kFound
  /// Without the parts that are not kFound.
  model::Response response;
  Estimate rise_time, fall_time;                 ///< [s]
  std::array<Estimate, model::kMaxPlays> reach;  ///< [Pa]; error 0 if it was held
  std::array<Estimate, model::kMaxPlays> weight;
  /// Of the readings about the best curve without a response; of positions their distance.
  double static_rms = 0.0;
  double rms = 0.0;           ///< with it
  Eigen::MatrixXd effective;  ///< (rows x actuators) [Pa]

  bool fitted() const { return failure.empty(); }
};

/// Response from the shortening of actuators, as functions of one unknown curve.
///
/// The plays come from one linear least squares for the inverse curve and the weights together,
///     sum_k b_k u^k - sum_j a_j (y_j - x) = x,   k = 0 .. 5,  a_j >= 0,
/// with thresholds at 1/40, 1/20, 1/10 and 1/5 of the range of the pressures, of which those within
/// two standard errors of 0 are left out, or from one play whose reach is fitted as well, where
/// that explains as much. The lags, and all standard errors, come from a least squares of the
/// readings in which the curve is eliminated (variable projection). Standard errors count readings
/// that are correlated in time as fewer. Of three trials or more, plays must also predict each from
/// the others better than none, by two standard errors of the differences.
///
/// @param history     measured pressures. Without times the arm rests at every row.
/// @param shortening  (rows x actuators) in any unit; NaN where there is no reading.
ResponseFit fitResponse(const model::InputHistory& history, const Eigen::MatrixXd& shortening);

/// The same from positions of one point of an arm, as polynomials of the pressures that move: those
/// with at least a tenth of the largest range. Their degree is 2, or 3 or 4 where that explains
/// enough more of the readings for its coefficients, and predicts trials that were left out better.
/// The weights start from each threshold in turn.
///
/// @param position  (rows x 1 to 3) [m]; NaN where there is no reading.
ResponseFit fitResponseToPositions(const model::InputHistory& history,
                                   const Eigen::MatrixXd& position);

}  // namespace helix_arm::estimation
