#pragma once

#include <Eigen/Core>
#include <array>
#include <string>

#include "helix_arm/model/arm_response.hpp"

namespace helix_arm::estimation {

/// Verdict on a part of a response.
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
  /// Residual of the readings about the best curve without a response; of positions their distance.
  double static_rms = 0.0;
  double rms = 0.0;  ///< with it

  bool fitted() const { return failure.empty(); }
};

/// Effective pressures (rows) of one actuator through a history [Pa].
Eigen::VectorXd effectiveOf(const model::InputHistory& history, Eigen::Index actuator,
                            const model::Response& response);

/// Response from the shortening of one actuator, as a function of its effective pressure: a
/// polynomial of degree 5 or, of few pressures, less.
///
/// Lags, weights and, of a single play, its reach come from a least squares of the readings in
/// which the curve is eliminated (variable projection). It starts from lags and plays on a grid,
/// and from plays with thresholds at 1/40, 1/20, 1/10 and 1/5 of the range of the pressures; what
/// is within two standard errors of 0 is left out. Standard errors count readings that are
/// correlated in time as fewer. Of three trials or more, plays must also predict each from the
/// others better than none, by two standard errors of the differences.
///
/// @param history     measured pressures (rows x 1). Without times the arm rests at every row.
/// @param shortening  (rows) in any unit; NaN where there is no reading.
ResponseFit fitResponse(const model::InputHistory& history, const Eigen::VectorXd& shortening);

/// The same from positions of one point of an arm, as polynomials of the pressures that move: those
/// with at least a tenth of the largest range. Their degree is 2, or 3 or 4 where that explains
/// enough more of the readings for its coefficients, and predicts trials that were left out better.
///
/// @param position  (rows x 1 to 3) [m]; NaN where there is no reading.
ResponseFit fitResponseToPositions(const model::InputHistory& history,
                                   const Eigen::MatrixXd& position);

}  // namespace helix_arm::estimation
