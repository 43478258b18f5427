#pragma once

#include <array>

namespace helix_arm::model {

struct Range;

/// Maximum number of plays of a response.
inline constexpr int kMaxPlays = 4;

/// How an actuator follows its measured input p, as a lag x and plays y_j behind it:
///
///     x' = (p - x) / tau,  tau = rise_time where p > x, else fall_time
///     y_j = min(max(y_j, x - r_j), x + r_j)
///     w = (1 - sum a_j) x + sum a_j y_j
///
/// Its contraction curve takes w in place of p: l = L(w). w stays within the inputs visited, so the
/// curve is not extrapolated, and dw/dx lies between 1 - sum a_j and 1.
struct Response {
  struct Play {
    double reach = 0.0;   ///< r_j > 0 [Pa]: how far x turns back before the play follows, halved
    double weight = 0.0;  ///< a_j >= 0
  };
  /// Largest sum of the weights: with 1, an input would not be determined by what it is to give.
  static constexpr double kMostWeight = 0.95;

  double rise_time = 0.0;  ///< tau where the input rises, >= 0 [s]
  double fall_time = 0.0;  ///< tau where it falls, >= 0 [s]
  int play_count = 0;
  std::array<Play, kMaxPlays> plays{};  ///< the first play_count count; by ascending reach

  /// Whether w = p: neither lag nor play.
  bool instant() const { return rise_time == 0 && fall_time == 0 && play_count == 0; }
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

/// Lag and plays of one actuator at present. Fixed size; no call allocates.
///
/// Starts at the first input with y_j = x, which is known to +- r_j; each play is known once no
/// place that it may have started from makes a difference.
class ResponseState {
 public:
  /// @throws as Response::validate().
  explicit ResponseState(const Response& response = {});

  /// Takes another response, and keeps x and y_j. A play whose reach changes is unknown again.
  /// @throws as Response::validate().
  void adopt(const Response& response);
  /// Forgets everything; the next input starts anew.
  void restart() { started_ = false; }

  /// Follows an input that holds for dt >= 0 [s], exactly, whatever the size of dt; infinity is a
  /// rest. An input that is not finite, or a dt that is negative or NaN, changes nothing. The first
  /// input is a start: the actuator is taken to rest there.
  void step(double input, double dt) noexcept;
  /// The same, with shares kept from the actuators before.
  void step(double input, double dt, LagShare& rise, LagShare& fall) noexcept;

  const Response& response() const { return response_; }
  /// Whether an input has come.
  bool started() const { return started_; }
  /// x [Pa]; NaN before the first input.
  double lagged() const;
  /// w [Pa]; NaN before the first input.
  double effective() const;
  /// Whether w is independent of what came before the start.
  bool known() const;
  /// Largest error of w from what is unknown of the start [Pa]: at first Response::halfWidth(),
  /// then less, and 0 once known().
  double uncertainty() const;

  /// w after a move of x, in one direction, to the given one: f(x), rising. Only after a start.
  double effectiveAt(double x) const noexcept;
  /// The x, within limits, with effectiveAt(x) = effective: the exact inverse. A effective outside
  /// of effectiveRange(limits) gives the nearer limit. Only after a start.
  double inputFor(double effective, const Range& limits) const noexcept;
  /// [f(lower), f(upper)]: all that moves within limits can reach. Only after a start.
  Range effectiveRange(const Range& limits) const noexcept;

 private:
  struct Memory {
    double y = 0.0;      // y_j
    double lower = 0.0;  // least and largest place where it may be
    double upper = 0.0;
  };
  void start(double input) noexcept;
  void forget(int j) noexcept;

  Response response_;
  double x_ = 0.0;
  std::array<Memory, kMaxPlays> memory_{};
  bool started_ = false;
};

}  // namespace helix_arm::model
