#pragma once

#include <cstddef>
#include <exception>
#include <limits>
#include <string>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/procedures/calibration_words.hpp"
#include "ros_bridge/common/log.hpp"

/// What the services of calibration and its action answer.
namespace helix_arm::ros_bridge {

/// Runs what answers a service; what it throws is the answer.
/// @return true: the answer is sent.
template <class Response, class Body>
bool answer(const char* service, Response& response, const Body& body) {
  try {
    body();
  } catch (const std::exception& fault) {
    response.success = false;
    response.message = basics::printableLines(fault.what());
  }
  if (response.success) {
    logInfo("%s: %s", service, response.message.c_str());
  } else {
    logWarning("%s: %s", service, response.message.c_str());
  }
  return true;
}

/// Fills the response of the service or the result of the action.
/// @param path  Of the calibrated scene.
template <class Answer>
void fill(Answer& out, const procedures::CalibrationOutcome& outcome, const std::string& path) {
  out.success = outcome.success;
  out.message = outcome.message;
  out.warnings = outcome.warnings;
  out.held_out_error = std::numeric_limits<double>::quiet_NaN();
  constexpr double kUndetermined = std::numeric_limits<double>::quiet_NaN();
  out.tip_error_before = outcome.tip_error_before.value_or(kUndetermined);
  out.tip_error_after = outcome.tip_error_after.value_or(kUndetermined);
  if (outcome.success) out.out = path;
  for (const estimation::Parameter& parameter : procedures::parametersOf(outcome)) {
    out.names.push_back(parameter.name);
    out.units.push_back(parameter.unit);
    out.initial.push_back(parameter.initial);
    out.values.push_back(parameter.value);
    out.standard_errors.push_back(parameter.standard_error);
    out.identifiable.push_back(parameter.identifiable);
  }
  if (outcome.response) {
    out.rms = outcome.response->fit.rms;
    out.error_unit = "m";
  }
  if (!outcome.calibration) return;
  const estimation::Calibration& calibration = *outcome.calibration;
  out.rms = calibration.rms;
  out.error_unit = calibration.error_unit;
  if (calibration.by_pressure) out.held_out_error = calibration.by_pressure->error;
  for (const Eigen::VectorXd& row : calibration.next_pressures) {
    out.next_pressures.insert(out.next_pressures.end(), row.begin(), row.end());
  }
}

}  // namespace helix_arm::ros_bridge
