#include "loop_diagnostics.hpp"

#include <cmath>
#include <cstddef>
#include <cstdio>

#include "ros_bridge/common/log.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

void CalibrationWatch::note(double time, const Estimate& estimate) {
  if (time < last_time_) since_.clear();
  last_time_ = time;
  since_.resize(estimate.names.size());
  advice_.clear();
  for (std::size_t k = 0; k < since_.size(); ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    const double prior = estimate.prior[i];
    const bool differs =
        std::abs(estimate.value[i]) > kSigmas * prior && estimate.deviation[i] < kKnown * prior;
    if (!differs) {
      since_[k].reset();
      continue;
    }
    if (!since_[k]) since_[k] = time;
    if (time - *since_[k] < kPatience) continue;
    char text[32];
    std::snprintf(text, sizeof text, " %+.1f %%", 100 * std::expm1(estimate.value[i]));
    advice_ += (advice_.empty() ? "" : ", ") + estimate.names[k] + text;
  }
}

namespace {

using diagnostic_msgs::DiagnosticStatus;
using follow::LoopState;

std::uint8_t levelOf(LoopState state) {
  switch (state) {
    case LoopState::kOpen:
    case LoopState::kCoasting:
    case LoopState::kYielding:
    case LoopState::kDoubtful:
      return DiagnosticStatus::WARN;
    case LoopState::kDiverging:
      return DiagnosticStatus::ERROR;
    case LoopState::kIdle:
    case LoopState::kClosed:
      break;
  }
  return DiagnosticStatus::OK;
}

std::string wrongStampText(double lead, estimation::ObservationFault fault) {
  return "the last picture is stamped " + fixed(std::abs(lead), 2) + " s " +
         (lead > 0 ? "after" : "before") + " the last reading of the pressures, and refused (" +
         estimation::nameOf(fault) + "): synchronise the clocks of camera and arm" +
         (lead > 0 ? "" : ", or shorten the delay of the pictures");
}

std::string percent(double logarithm) { return fixed(100 * std::expm1(logarithm), 2); }

}  // namespace

void LoopDiagnostics::saw(double time, double lead, const estimation::Observation& observation,
                          const estimation::ArmFilter& filter, bool with_tags) {
  using estimation::ObservationFault;
  const bool stamped_wrong = observation.fault == ObservationFault::kFuture ||
                             observation.fault == ObservationFault::kTooOld;
  wrong_stamp_ = stamped_wrong ? wrongStampText(lead, observation.fault) : "";
  if (!observation.accepted()) {
    ++refused_;
    ++by_fault_[static_cast<std::size_t>(observation.fault)];
    return;
  }
  ++accepted_;
  if (!with_tags) ++without_tags_;
  const int count = filter.parameterCount();
  const estimation::Gaussian& state = filter.state();
  calibration_.note(time,
                    {filter.parameterNames(), state.mean.head(count),
                     state.covariance.diagonal().head(count).cwiseSqrt(), filter.parameterPrior()});
}

void LoopDiagnostics::sawForeign(const std::string& why) {
  ++refused_;
  if (!foreign_.add()) return;
  logWarning("a message on measured was dropped (%lu so far): %s", foreign_.total(), why.c_str());
}

DiagnosticStatus LoopDiagnostics::loop(const std::string& node, const follow::VisualServo& loop,
                                       const std::string& message) const {
  DiagnosticStatus out;
  out.name = statusName(node, names::kLoopStatus);
  out.level = levelOf(loop.state());
  out.message = message;
  addValue(out, names::kStateKey, follow::nameOf(loop.state()));
  addValue(out, names::kAcceptedKey, std::to_string(accepted_));
  addValue(out, names::kWithoutTagsKey, std::to_string(without_tags_));
  for (int i = 1; i < estimation::kObservationFaultCount; ++i) {
    const auto fault = static_cast<estimation::ObservationFault>(i);
    addValue(out, names::kRefusedPrefix + std::string(estimation::nameOf(fault)),
             std::to_string(by_fault_[static_cast<std::size_t>(i)]));
  }
  addValue(out, names::kRefusedPrefix + std::string("foreign"), std::to_string(foreign_.total()));
  addValue(out, "tip_sd_mm", fixed(1e3 * loop.tipDeviation(), 2));
  addValue(out, "drift_mm", fixed(1e3 * loop.drift().distance, 2));
  addValue(out, "drift_allowed_mm", fixed(1e3 * loop.drift().allowed, 2));
  addValue(out, "error_mm", loop.error() ? fixed(1e3 * *loop.error(), 2) : "");
  return out;
}

DiagnosticStatus LoopDiagnostics::correction(const std::string& node,
                                             const follow::VisualServo& loop) const {
  const estimation::ArmFilter& filter = loop.tracker();
  const estimation::Gaussian& state = filter.state();
  DiagnosticStatus out;
  out.name = statusName(node, names::kCorrectionStatus);
  const std::string& advice = calibration_.advice();
  out.level = advice.empty() ? DiagnosticStatus::OK : DiagnosticStatus::WARN;
  out.message =
      advice.empty() ? "the arm is as its calibration says" : "calibrate again: " + advice;
  const int count = filter.parameterCount();
  for (int i = 0; i < count; ++i) {
    addValue(out, filter.parameterNames()[static_cast<std::size_t>(i)] + " [%]",
             percent(state.mean[i]) + " +- " +
                 percent(std::sqrt(std::max(0.0, state.covariance(i, i)))));
  }
  const auto& rows = filter.rows();
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const bool moves = rows[k] % 6 < 3;
    addValue(out,
             "bias of section " + std::to_string(rows[k] / 6 + 1) + ", " + (moves ? "v_" : "w_") +
                 "xyz"[rows[k] % 3] + (moves ? " [mm]" : " [mrad]"),
             fixed(1e3 * state.mean[count + static_cast<Eigen::Index>(k)], 2));
  }
  return out;
}

}  // namespace helix_arm::ros_bridge
