#include "helix_arm/model/response.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/contraction.hpp"

namespace helix_arm::model {
namespace {

constexpr char kResponseCulprit[] = "response";

double followPlay(double y, double x, double reach) {
  return std::min(std::max(y, x - reach), x + reach);
}

}  // namespace

double Response::halfWidth() const {
  double sum = 0.0;
  for (int j = 0; j < play_count; ++j) sum += plays[j].weight * plays[j].reach;
  return sum;
}

double Response::weights() const {
  double sum = slow_weight;
  for (int j = 0; j < play_count; ++j) sum += plays[j].weight;
  return sum;
}

double Response::restTime() const {
  return slow_time == 0 ? 0.0 : kRestTimes * (slow_time + std::max(rise_time, fall_time));
}

double Response::stroke() const { return play_count == 0 ? 0.0 : 2 * plays[play_count - 1].reach; }

void Response::validate() const {
  basics::requireNotNegative(kResponseCulprit, "the rise time constant [s]", rise_time);
  basics::requireNotNegative(kResponseCulprit, "the fall time constant [s]", fall_time);
  basics::requireValue(play_count >= 0 && play_count <= kMaxPlays, kResponseCulprit,
                       "the number of plays", play_count, "0 to " + std::to_string(kMaxPlays));
  double before = 0.0;
  for (int j = 0; j < play_count; ++j) {
    const Play& play = plays[j];
    basics::requirePositive(kResponseCulprit, "a play [Pa]", play.reach);
    basics::require(play.reach > before, "response: the plays [Pa] fall from ", before, " to ",
                    play.reach, "; expected ascending values");
    basics::requireNotNegative(kResponseCulprit, "the weight of a play", play.weight);
    before = play.reach;
  }
  basics::requireNotNegative(kResponseCulprit, "the slow time constant [s]", slow_time);
  basics::requireNotNegative(kResponseCulprit, "the slow weight", slow_weight);
  basics::requireValue(slow_weight == 0 || slow_time > 0, kResponseCulprit, "the slow weight",
                       slow_weight, "0 without a slow time constant");
  const double sum = weights();
  // The rounding of decimals such as 0.3 + 0.65 is none of the user's.
  basics::requireValue(sum <= kMostWeight + 1e-12, kResponseCulprit, "the sum of the weights", sum,
                       "at most 0.95");
}

ResponseState::ResponseState(const Response& response) : response_(response) {
  response_.validate();
}

void ResponseState::adopt(const Response& response) {
  response.validate();
  const Response before = response_;
  response_ = response;
  if (!started_) return;
  for (int j = 0; j < response_.play_count; ++j) {
    if (j >= before.play_count) memory_[j].y = x_;
    const double reach = response_.plays[j].reach;
    memory_[j].y = followPlay(memory_[j].y, x_, reach);
    if (j >= before.play_count) {
      forget(j);
    } else {
      const double change = std::abs(reach - before.plays[j].reach);
      memory_[j].lower = std::max(memory_[j].lower - change, x_ - reach);
      memory_[j].upper = std::min(memory_[j].upper + change, x_ + reach);
    }
  }
  if (before.slow_time == 0) s_ = x_;
  if (response_.slow_time != before.slow_time) {
    slow_start_ = s_;
    slow_age_ = 0.0;
  }
}

void ResponseState::forget(int j) noexcept {
  memory_[j].lower = x_ - response_.plays[j].reach;
  memory_[j].upper = x_ + response_.plays[j].reach;
}

void ResponseState::start(double input, double held) noexcept {
  started_ = true;
  x_ = s_ = slow_start_ = input;
  slow_age_ = held;
  for (int j = 0; j < response_.play_count; ++j) {
    memory_[j].y = x_;
    forget(j);
  }
}

double LagShare::of(double dt, double time_constant) noexcept {
  if (time_constant == 0) return 1.0;
  if (dt != dt_ || time_constant != time_constant_) {
    dt_ = dt;
    time_constant_ = time_constant;
    share_ = -std::expm1(-dt / time_constant);
  }
  return share_;
}

double SlowShare::of(double dt, double time_constant, double slow_time) noexcept {
  if (time_constant == 0 || dt == 0 || std::isinf(dt)) return 0.0;
  if (dt != dt_ || time_constant != time_constant_ || slow_time != slow_time_) {
    dt_ = dt;
    time_constant_ = time_constant;
    slow_time_ = slow_time;
    // T^-1 (exp(-b dt) - exp(-c dt)) / (c - b) with the rates b <= c, exact also where b is near c.
    const double lag = dt / time_constant, slow = dt / slow_time, apart = std::abs(slow - lag);
    share_ =
        slow * std::exp(-std::min(slow, lag)) * (apart == 0 ? 1.0 : -std::expm1(-apart) / apart);
  }
  return share_;
}

void ResponseState::step(double input, double dt) noexcept {
  ResponseShares shares;
  step(input, dt, shares);
}

// Before the step of the lag.
void ResponseState::stepSlow(double input, double dt, ResponseShares& shares) noexcept {
  const double covered = shares.slow.of(dt, response_.slow_time);
  const double taken = input > x_
                           ? shares.slow_rise.of(dt, response_.rise_time, response_.slow_time)
                           : shares.slow_fall.of(dt, response_.fall_time, response_.slow_time);
  s_ = covered == 1 ? input : s_ + covered * (input - s_);
  s_ += taken * (x_ - input);
  slow_age_ += dt;
}

void ResponseState::step(double input, double dt, ResponseShares& shares) noexcept {
  if (!std::isfinite(input) || !(dt >= 0)) return;
  if (!started_) return start(input, dt);
  if (creeps()) stepSlow(input, dt, shares);
  const double covered = input > x_ ? shares.rise.of(dt, response_.rise_time)
                                    : shares.fall.of(dt, response_.fall_time);
  x_ = covered == 1 ? input : x_ + covered * (input - x_);
  for (int j = 0; j < response_.play_count; ++j) {
    const double reach = response_.plays[j].reach;
    Memory& memory = memory_[j];
    memory.y = followPlay(memory.y, x_, reach);
    if (memory.lower == memory.upper) {
      memory.lower = memory.upper = memory.y;
    } else {
      memory.lower = followPlay(memory.lower, x_, reach);
      memory.upper = followPlay(memory.upper, x_, reach);
    }
  }
}

double ResponseState::lagged() const {
  return started_ ? x_ : std::numeric_limits<double>::quiet_NaN();
}

double ResponseState::effective() const {
  if (!started_) return std::numeric_limits<double>::quiet_NaN();
  double effective = x_;
  for (int j = 0; j < response_.play_count; ++j) {
    effective += response_.plays[j].weight * (memory_[j].y - x_);
  }
  if (creeps()) effective += response_.slow_weight * (s_ - x_);
  return effective;
}

bool ResponseState::known() const {
  for (int j = 0; j < response_.play_count; ++j) {
    if (memory_[j].lower != memory_[j].upper) return false;
  }
  return started_ && (!creeps() || slow_age_ >= Response::kRestTimes * response_.slow_time);
}

double ResponseState::uncertainty(const Range& past) const {
  if (!started_) {
    return response_.halfWidth() + response_.slow_weight * (past.upper - past.lower);
  }
  double sum = 0.0;
  for (int j = 0; j < response_.play_count; ++j) {
    const Memory& memory = memory_[j];
    sum += response_.plays[j].weight * std::max(memory.upper - memory.y, memory.y - memory.lower);
  }
  if (creeps()) {
    const double apart = std::max(past.upper - slow_start_, slow_start_ - past.lower);
    sum += response_.slow_weight * apart * std::exp(-slow_age_ / response_.slow_time);
  }
  return sum;
}

double ResponseState::effectiveAt(double x, AfterMove after) const noexcept {
  // As x plus what the others are behind: without any it is x, bit for bit.
  double effective = x;
  for (int j = 0; j < response_.play_count; ++j) {
    const Response::Play& play = response_.plays[j];
    effective += play.weight * (followPlay(memory_[j].y, x, play.reach) - x);
  }
  if (creeps() && after == AfterMove::kSlowHeld) effective += response_.slow_weight * (s_ - x);
  return effective;
}

double ResponseState::inputFor(double effective, const Range& limits,
                               AfterMove after) const noexcept {
  // f rises and is linear between its kinks y_j -+ r_j.
  std::array<double, 2 * kMaxPlays> kinks{};
  int count = 0;
  const auto insert = [&](double kink) {
    int place = count++;
    for (; place > 0 && kinks[place - 1] > kink; --place) kinks[place] = kinks[place - 1];
    kinks[place] = kink;
  };
  for (int j = 0; j < response_.play_count; ++j) {
    insert(memory_[j].y - response_.plays[j].reach);
    insert(memory_[j].y + response_.plays[j].reach);
  }
  int piece = 0;  // between the kinks piece - 1 and piece
  while (piece < count && effectiveAt(kinks[piece], after) <= effective) ++piece;
  double x = effective;
  const bool held = creeps() && after == AfterMove::kSlowHeld;
  if (count > 0 || held) {
    const double kink = count > 0 ? kinks[std::max(piece - 1, 0)] : s_;
    double slope = held ? 1.0 - response_.slow_weight : 1.0;
    if (piece > 0 && piece < count) {
      const double middle = 0.5 * (kinks[piece - 1] + kinks[piece]);
      for (int j = 0; j < response_.play_count; ++j) {
        const bool rests = std::abs(middle - memory_[j].y) < response_.plays[j].reach;
        if (rests) slope -= response_.plays[j].weight;
      }
    }
    x = kink + (effective - effectiveAt(kink, after)) / slope;
  }
  return std::min(std::max(x, limits.lower), limits.upper);
}

Range ResponseState::effectiveRange(const Range& limits, AfterMove after) const noexcept {
  return {effectiveAt(limits.lower, after), effectiveAt(limits.upper, after)};
}

}  // namespace helix_arm::model
