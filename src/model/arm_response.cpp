#include "helix_arm/model/arm_response.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::model {
namespace {

constexpr double kNotRead = std::numeric_limits<double>::quiet_NaN();
// Weight of a play of which only the width is known. With more, an input within the play moves by
// more than twice of what an arm needs whose plays weigh 0.7, and swings.
constexpr double kLearntWeight = 0.85;

}  // namespace

ArmResponse::ArmResponse(const Arm& arm, const std::optional<Response>& response)
    : common_(response),
      times_(static_cast<std::size_t>(arm.actuatorCount()), kNotRead),
      effective_(Eigen::VectorXd::Constant(arm.actuatorCount(), kNotRead)) {
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    states_.emplace_back(common_.value_or(arm.actuator(i).response));
  }
}

void ArmResponse::requireSize(Eigen::Index count) const {
  basics::requireValue(count == effective_.size(), "responses", "the number of inputs", count,
                       "one per actuator");
}

void ArmResponse::adopt(const Arm& arm) {
  requireSize(arm.actuatorCount());
  for (int i = 0; i < size(); ++i) {
    ResponseState& state = states_[static_cast<std::size_t>(i)];
    state.adopt(common_.value_or(arm.actuator(i).response));
    if (state.started()) effective_[i] = state.effective();
  }
}

void ArmResponse::set(double lag, double half_width) {
  Response response;
  response.rise_time = response.fall_time = lag;
  response.play_count = half_width > 0 ? 1 : 0;
  response.plays[0] = {half_width / kLearntWeight, kLearntWeight};
  for (ResponseState& state : states_) state.adopt(response);
}

void ArmResponse::restart() {
  for (ResponseState& state : states_) state.restart();
  std::fill(times_.begin(), times_.end(), kNotRead);
  effective_.setConstant(kNotRead);
}

void ArmResponse::stepOne(Eigen::Index i, double input, double dt) noexcept {
  ResponseState& state = states_[static_cast<std::size_t>(i)];
  state.step(input, dt, shares_);
  effective_[i] = state.response().instant() ? input : state.effective();
}

bool ArmResponse::follow(double time, const InputRef& input) {
  requireSize(input.size());
  const bool back =
      std::any_of(times_.begin(), times_.end(), [time](double last) { return time < last; });
  if (back) restart();
  for (Eigen::Index i = 0; i < input.size(); ++i) {
    double& last = times_[static_cast<std::size_t>(i)];
    stepOne(i, input[i], std::isnan(last) ? 0.0 : time - last);
    if (std::isfinite(input[i])) last = time;
  }
  return back;
}

void ArmResponse::follow(const InputHistory& history, Eigen::Index row) {
  const auto k = static_cast<std::size_t>(row);
  if (history.starts_anew[k]) restart();
  const Eigen::VectorXd input = history.input.row(row);
  if (history.time.empty()) {
    step(input, std::numeric_limits<double>::infinity());
  } else {
    follow(history.time[k], input);
  }
}

void ArmResponse::step(const InputRef& input, double dt) {
  requireSize(input.size());
  for (Eigen::Index i = 0; i < input.size(); ++i) stepOne(i, input[i], dt);
}

bool ArmResponse::instant() const {
  return std::all_of(states_.begin(), states_.end(),
                     [](const ResponseState& state) { return state.response().instant(); });
}

bool ArmResponse::known() const {
  return std::all_of(states_.begin(), states_.end(),
                     [](const ResponseState& state) { return state.known(); });
}

double ArmResponse::restTime() const {
  double longest = 0.0;
  for (const ResponseState& state : states_) {
    longest = std::max(longest, state.response().restTime());
  }
  return longest;
}

Eigen::VectorXd ArmResponse::uncertainty(const Arm& arm) const {
  Eigen::VectorXd out(size());
  for (int i = 0; i < size(); ++i) out[i] = state(i).uncertainty(arm.actuator(i).limits);
  return out;
}

void ArmResponse::effectiveLimits(const Arm& arm, Eigen::Ref<Eigen::VectorXd> lower,
                                  Eigen::Ref<Eigen::VectorXd> upper,
                                  AfterMove after) const noexcept {
  for (int i = 0; i < size(); ++i) {
    const Range& limits = arm.actuator(i).limits;
    const Range effective = state(i).started() ? state(i).effectiveRange(limits, after) : limits;
    // Readings may have been outside of the limits, where the curve may end.
    lower[i] = std::clamp(effective.lower, limits.lower, limits.upper);
    upper[i] = std::clamp(effective.upper, limits.lower, limits.upper);
  }
}

Eigen::VectorXd ArmResponse::effectiveAt(const InputRef& input, AfterMove after) const {
  requireSize(input.size());
  Eigen::VectorXd out = input;
  for (int i = 0; i < size(); ++i) {
    if (state(i).started()) out[i] = state(i).effectiveAt(input[i], after);
  }
  return out;
}

void ArmResponse::inputsFor(const Arm& arm, const InputRef& effective,
                            Eigen::Ref<Eigen::VectorXd> input, AfterMove after) const noexcept {
  for (int i = 0; i < size(); ++i) {
    const Range& limits = arm.actuator(i).limits;
    input[i] = state(i).started() ? state(i).inputFor(effective[i], limits, after)
                                  : std::clamp(effective[i], limits.lower, limits.upper);
  }
}

}  // namespace helix_arm::model
