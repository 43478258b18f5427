#pragma once

#include <array>

namespace helix_arm::model {

struct Range;

/// Maximum number of plays of a response.
inline constexpr int kMaxPlays = 4;

/// How an actuator follows its measured input p, as a lag x, and plays y_j and a slow state s (the
/// creep of rubber) behind it:
///
///     x' = (p - x) / tau,  tau = rise_time where p > x, else fall_time
///     y_j = min(max(y_j, x - r_j), x + r_j)
///     s' = (x - s) / T,  T = slow_time
///     w = (1 - sum a_j - a) x + sum a_j y_j + a s,  a = slow_weight
///
/// Its contraction curve takes w in place of p: l = L(w). w stays within the inputs visited, so the
/// curve is not extrapolated. While s holds, dw/dx lies between 1 - sum a_j - a and 1 - a.
struct Response {
  /// One play operator.
  struct Play {
    double reach = 0.0;   ///< r_j > 0 [Pa]: how far x turns back before the play follows, halved
    double weight = 0.0;  ///< a_j >= 0
  };
  /// Largest sum of the weights: with 1, an input would not be determined by what it is to give.
  static constexpr double kMostWeight = 0.95;
  /// Time constants in which a slow state comes to rest: exp(-5) = 0.7 % of its distance is left.
  static constexpr double kRestTimes = 5.0;

  double rise_time = 0.0;  ///< tau where the input rises, >= 0 [s]
  double fall_time = 0.0;  ///< tau where it falls, >= 0 [s]
  int play_count = 0;
  std::array<Play, kMaxPlays> plays{};  ///< the first play_count count; by ascending reach
  double slow_time = 0.0;               ///< T >= 0 [s]; 0: no slow state
  double slow_weight = 0.0;             ///< a >= 0

  /// Whether w = p: neither lag, play nor slow state.
  bool instant() const {
    return rise_time == 0 && fall_time == 0 && play_count == 0 && slow_time == 0;
  }
  /// sum a_j + a.
  double weights() const;
  /// How long an input holds until a slow state is at rest [s]; 0 without one, since the end of a
  /// lag is seen: nothing moves any more.
  double restTime() const;
  /// Half the width of the hysteresis loop of large strokes, sum a_j r_j [Pa].
  double halfWidth() const;
  /// Stroke in one direction after which w is known whatever came before, 2 r_n [Pa].
  double stroke() const;
  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// The share of its way that a lag covers in a time, computed once for all actuators alike.
class LagShare {
 public:
  /// 1 - exp(-dt / time_constant); 1 without a lag.
  double of(double dt, double time_constant) noexcept;

 private:
  double dt_ = -1.0, time_constant_ = -1.0, share_ = 0.0;
};

/// Share that a slow state takes over of the distance between a lag and its input, computed once
/// for all actuators alike.
class SlowShare {
 public:
  /// The part of x - p at the begin that s - p has after dt, if s - p was 0, while p holds.
  double of(double dt, double time_constant, double slow_time) noexcept;

 private:
  double dt_ = -1.0, time_constant_ = -1.0, slow_time_ = -1.0, share_ = 0.0;
};

/// All that a step of a response takes of exponentials.
struct ResponseShares {
  LagShare rise, fall, slow;
  SlowShare slow_rise, slow_fall;
};

/// State that a move of x finds: the slow state where it was, as right after the move, or at rest
/// with x.
enum class AfterMove { kSlowHeld, kAtRest };

/// Lag, plays and slow state of one actuator at present. Fixed size; no call allocates.
///
/// Starts at the first input with y_j = s = x. y_j is known to +- r_j; each play is known once no
/// place that it may have started from makes a difference. s may have been anywhere where inputs
/// have been; what is unknown of it decays with exp(-t / T).
class ResponseState {
 public:
  /// @throws as Response::validate().
  explicit ResponseState(const Response& response = {});

  /// Takes another response, and keeps x, y_j and s. A play whose reach changes is known to within
  /// that change, a slow state whose time constant changes is unknown again.
  /// @throws as Response::validate().
  void adopt(const Response& response);
  /// Forgets everything; the next input starts anew.
  void restart() { started_ = false; }

  /// Follows an input that holds for dt >= 0 [s], exactly, whatever the size of dt; infinity is a
  /// rest. An input that is not finite, or a dt that is negative or NaN, changes nothing. The first
  /// input is a start: the actuator is taken to rest there.
  void step(double input, double dt) noexcept;
  /// The same, with shares kept from the actuators before.
  void step(double input, double dt, ResponseShares& shares) noexcept;

  const Response& response() const { return response_; }
  /// Whether an input has come.
  bool started() const { return started_; }
  /// x [Pa]; NaN before the first input.
  double lagged() const;
  /// w [Pa]; NaN before the first input.
  double effective() const;
  /// Whether w is independent of what came before the start; of a slow state, a share of
  /// exp(-Response::kRestTimes) may be left of that.
  bool known() const;
  /// Largest error of w from what is unknown of the start [Pa]: at first Response::halfWidth(),
  /// then less, and 0 once known(). A slow state adds at most slow_weight times the width of
  /// `past`, which decays with exp(-t / T).
  /// @param past  where inputs have been before the start: the actuator's limits.
  double uncertainty(const Range& past) const;

  /// w after a move of x, in one direction, to the given one: f(x), rising. Only after a start.
  double effectiveAt(double x, AfterMove after = AfterMove::kSlowHeld) const noexcept;
  /// The x, within limits, with effectiveAt(x, after) = effective: the exact inverse. A effective
  /// outside of effectiveRange(limits, after) gives the nearer limit. Only after a start.
  double inputFor(double effective, const Range& limits,
                  AfterMove after = AfterMove::kSlowHeld) const noexcept;
  /// [f(lower), f(upper)]: all that moves within limits can reach. Only after a start.
  Range effectiveRange(const Range& limits, AfterMove after = AfterMove::kSlowHeld) const noexcept;

 private:
  struct Memory {
    double y = 0.0;      // y_j
    double lower = 0.0;  // least and largest place where it may be
    double upper = 0.0;
  };
  void start(double input, double held) noexcept;
  void forget(int j) noexcept;
  void stepSlow(double input, double dt, ResponseShares& shares) noexcept;
  bool creeps() const { return response_.slow_time > 0; }

  Response response_;
  double x_ = 0.0;
  double s_ = 0.0;           // if there is a slow state, as what follows
  double slow_start_ = 0.0;  // s at its start
  double slow_age_ = 0.0;    // time since then [s]
  std::array<Memory, kMaxPlays> memory_{};
  bool started_ = false;
};

}  // namespace helix_arm::model
