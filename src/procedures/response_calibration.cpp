#include "response_calibration.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <utility>
#include <vector>

namespace helix_arm::procedures {
namespace {

using estimation::ResponseFit;
using estimation::ResponseVerdict;

// Of a direction that counts, relative to the largest motion.
constexpr double kLeastMotion = 0.5;

// The response as it is written: the fit's, but of the scene what the data do not determine.
model::Response written(const ResponseFit& fit, const model::Response& before) {
  model::Response out = fit.response;
  if (fit.lag == ResponseVerdict::kNotDetermined) {
    out.rise_time = before.rise_time;
    out.fall_time = before.fall_time;
  }
  if (fit.play == ResponseVerdict::kNotDetermined) {
    out.play_count = before.play_count;
    out.plays = before.plays;
  }
  return out;
}

std::optional<std::string> faultOf(const CalibrationRequest& request, const CalibrationData& data) {
  if (data.lengths.empty() && data.tips.empty()) {
    return "a response needs readings in the order taken; expected free lengths (pressure_kpa, "
           "length_m) or a series of the tip (time_s, pressure_1_kpa .., x_m, y_m, z_m)";
  }
  if (!data.lengths.empty() && !data.tips.empty()) {
    return "the data hold free lengths and a series of the tip; expected one of them for a "
           "response";
  }
  if (request.branch != estimation::Branch::kBoth) {
    return "a response explains the rising and the falling branch; expected both of them, but one "
           "was chosen";
  }
  return std::nullopt;
}

// The positions along the directions of the largest motions: across an arm. Those along it vary
// with the square of its bend and tell little of what muscles remember. NaN where there is none.
Eigen::MatrixXd largestMotions(const Eigen::MatrixXd& position) {
  std::vector<Eigen::Index> seen;
  for (Eigen::Index row = 0; row < position.rows(); ++row) {
    if (position.row(row).allFinite()) seen.push_back(row);
  }
  if (seen.empty()) return position;
  const Eigen::RowVectorXd mean = position(seen, Eigen::all).colwise().mean();
  const Eigen::MatrixXd about = position(seen, Eigen::all).rowwise() - mean;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(about.transpose() * about);
  const Eigen::Vector3d& squares = axes.eigenvalues();  // ascending
  const double least = kLeastMotion * kLeastMotion * squares[2];
  const auto count = (squares.array() >= least).count();
  return (position.rowwise() - mean) * axes.eigenvectors().rightCols(count);
}

// The numbers that were found.
std::vector<estimation::Parameter> numbersOf(const ResponseFit& fit,
                                             const model::Response& before) {
  std::vector<estimation::Parameter> out;
  const auto add = [&out](const std::string& name, const char* unit, double initial,
                          const estimation::Estimate& one) {
    out.push_back({name, unit, initial, one.value, one.standard_error, true});
  };
  if (fit.lag == ResponseVerdict::kFound) {
    add("rise_time_constant", "s", before.rise_time, fit.rise_time);
    add("fall_time_constant", "s", before.fall_time, fit.fall_time);
  }
  for (int j = 0; j < fit.response.play_count; ++j) {
    const auto play = static_cast<std::size_t>(j);
    const std::string number = std::to_string(j + 1);
    add("play_" + number, "Pa", before.plays[play].reach, fit.reach[play]);
    add("play_weight_" + number, "", before.plays[play].weight, fit.weight[play]);
  }
  return out;
}

// Before a capture, whose arm is at rest, effective pressures are averaged for so long [s].
constexpr double kEffectiveMean = 0.5;
// A series reaches so far beyond its last row [s].
constexpr double kSeriesHold = 0.5;

// Mean of the effective beyond the measured pressures before a time; nothing if no trial of the
// series covers it.
std::optional<Eigen::VectorXd> beyondAt(double time, const model::InputHistory& history,
                                        const Eigen::MatrixXd& beyond) {
  const std::vector<double>& times = history.time;
  for (std::size_t begin = 0, end = 0; begin < times.size(); begin = end) {
    for (end = begin + 1; end < times.size() && !history.starts_anew[end];) ++end;
    if (time < times[begin] || time > times[end - 1] + kSeriesHold) continue;
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(beyond.cols());
    int count = 0;
    for (std::size_t k = begin; k < end && times[k] <= time; ++k) {
      if (times[k] <= time - kEffectiveMean) continue;
      sum += beyond.row(static_cast<Eigen::Index>(k)).transpose();
      ++count;
    }
    if (count > 0) return sum / count;
  }
  return std::nullopt;
}

}  // namespace

EffectiveCaptures effectiveCaptures(const model::Arm& arm, const ResponseSeries& tips,
                                    std::vector<estimation::Capture> captures) {
  EffectiveCaptures out{std::move(captures), {}};
  model::ArmResponse response(arm);
  if (response.instant()) return out;
  const model::InputHistory& history = tips.history;
  Eigen::MatrixXd beyond(history.rows(), arm.actuatorCount());
  for (Eigen::Index row = 0; row < history.rows(); ++row) {
    response.follow(history, row);
    beyond.row(row) = response.effective().transpose() - history.input.row(row);
  }
  for (estimation::Capture& capture : out.captures) {
    const auto more =
        capture.time ? beyondAt(*capture.time, history, beyond) : std::optional<Eigen::VectorXd>();
    if (more) {
      capture.pressure = arm.clamped(capture.pressure + *more);
    } else {
      out.unknown.push_back(capture.number);
    }
  }
  return out;
}

std::optional<std::string> fitResponseOf(const io::Scene& scene, const CalibrationRequest& request,
                                         const CalibrationData& data,
                                         const std::vector<std::string>& names,
                                         CalibrationOutcome& outcome) {
  if (auto fault = faultOf(request, data)) return fault;
  const model::Response& before = scene.contractions.at(names.front());
  FittedResponse found{names, {}, {}, {}};
  if (data.tips.empty()) {
    const Eigen::MatrixXd& length = data.lengths.reading;
    found.fit =
        estimation::fitResponse(data.lengths.history, (length(0, 0) - length.array()).matrix());
  } else {
    found.fit =
        estimation::fitResponseToPositions(data.tips.history, largestMotions(data.tips.reading));
  }
  if (!found.fit.fitted()) return "response: " + found.fit.failure;
  found.response = written(found.fit, before);
  found.parameters = numbersOf(found.fit, before);
  for (const std::string* reason : {&found.fit.lag_reason, &found.fit.play_reason}) {
    if (!reason->empty()) outcome.warnings.push_back("response: " + *reason);
  }
  outcome.response = std::move(found);
  return std::nullopt;
}

}  // namespace helix_arm::procedures
