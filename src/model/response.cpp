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

double Response::stroke() const { return play_count == 0 ? 0.0 : 2 * plays[play_count - 1].reach; }

void Response::validate() const {
  basics::requireNotNegative(kResponseCulprit, "the rise time constant [s]", rise_time);
  basics::requireNotNegative(kResponseCulprit, "the fall time constant [s]", fall_time);
  basics::requireValue(play_count >= 0 && play_count <= kMaxPlays, kResponseCulprit,
                       "the number of plays", play_count, "0 to " + std::to_string(kMaxPlays));
  double sum = 0.0, before = 0.0;
  for (int j = 0; j < play_count; ++j) {
    const Play& play = plays[j];
    basics::requirePositive(kResponseCulprit, "a play [Pa]", play.reach);
    basics::require(play.reach > before, "response: the plays [Pa] fall from ", before, " to ",
                    play.reach, "; expected ascending values");
    basics::requireNotNegative(kResponseCulprit, "the weight of a play", play.weight);
    before = play.reach;
    sum += play.weight;
  }
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
}

void ResponseState::forget(int j) noexcept {
  memory_[j].lower = x_ - response_.plays[j].reach;
  memory_[j].upper = x_ + response_.plays[j].reach;
}

void ResponseState::start(double input) noexcept {
  started_ = true;
  x_ = input;
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

void ResponseState::step(double input, double dt) noexcept {
  LagShare rise, fall;
  step(input, dt, rise, fall);
}

void ResponseState::step(double input, double dt, LagShare& rise, LagShare& fall) noexcept {
  if (!std::isfinite(input) || !(dt >= 0)) return;
  if (!started_) return start(input);
  const double covered =
      input > x_ ? rise.of(dt, response_.rise_time) : fall.of(dt, response_.fall_time);
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
  return effective;
}

bool ResponseState::known() const {
  for (int j = 0; j < response_.play_count; ++j) {
    if (memory_[j].lower != memory_[j].upper) return false;
  }
  return started_;
}

double ResponseState::uncertainty() const {
  double sum = 0.0;
  for (int j = 0; j < response_.play_count; ++j) {
    const Memory& memory = memory_[j];
    sum += response_.plays[j].weight * std::max(memory.upper - memory.y, memory.y - memory.lower);
  }
  return started_ ? sum : response_.halfWidth();
}

double ResponseState::effectiveAt(double x) const noexcept {
  // As x plus what the plays are behind: without plays it is x, bit for bit.
  double effective = x;
  for (int j = 0; j < response_.play_count; ++j) {
    const Response::Play& play = response_.plays[j];
    effective += play.weight * (followPlay(memory_[j].y, x, play.reach) - x);
  }
  return effective;
}

double ResponseState::inputFor(double effective, const Range& limits) const noexcept {
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
  while (piece < count && effectiveAt(kinks[piece]) <= effective) ++piece;
  double x = effective;
  if (count > 0) {
    const double kink = kinks[std::max(piece - 1, 0)];
    double slope = 1.0;
    if (piece > 0 && piece < count) {
      const double middle = 0.5 * (kinks[piece - 1] + kinks[piece]);
      for (int j = 0; j < response_.play_count; ++j) {
        const bool rests = std::abs(middle - memory_[j].y) < response_.plays[j].reach;
        if (rests) slope -= response_.plays[j].weight;
      }
    }
    x = kink + (effective - effectiveAt(kink)) / slope;
  }
  return std::min(std::max(x, limits.lower), limits.upper);
}

Range ResponseState::effectiveRange(const Range& limits) const noexcept {
  return {effectiveAt(limits.lower), effectiveAt(limits.upper)};
}

}  // namespace helix_arm::model
