#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/response.hpp"

namespace helix_arm::model {

/// Measured inputs in the order in which they were taken.
struct InputHistory {
  Eigen::MatrixXd input;          ///< (rows x actuators); pressures are gauge [Pa]
  std::vector<double> time;       ///< (rows) [s]; empty: the arm rests at every row
  std::vector<bool> starts_anew;  ///< (rows) whether a trial begins there: nothing is remembered

  Eigen::Index rows() const { return input.rows(); }
};

/// The responses of all actuators of an arm at present: from measured inputs to the inputs that
/// are effective in their contraction curves. All memory is allocated in the constructor.
class ArmResponse {
 public:
  /// @param response  of every actuator in place of its own.
  explicit ArmResponse(const Arm& arm, const std::optional<Response>& response = std::nullopt);

  /// Takes the responses of an arm with as many actuators, and keeps what they remember.
  /// @throws std::invalid_argument on another number of actuators.
  void adopt(const Arm& arm);
  /// Gives every actuator this lag [s] and half width of hysteresis [Pa], >= 0, and keeps what they
  /// remember.
  void set(double lag, double half_width);
  /// Forgets everything.
  void restart();

  /// Follows the inputs (n) read at a time [s], which hold since the last ones. An input that is
  /// not finite steps nothing of its actuator, whose next step covers its time too. A time that
  /// goes back, as when a recording starts over, restarts all.
  /// @return whether it went back. @throws std::invalid_argument on a wrong size.
  bool follow(double time, const InputRef& input);
  /// Follows a row of a history. Throws as follow().
  void follow(const InputHistory& history, Eigen::Index row);
  /// Follows inputs (n) that hold for dt >= 0 [s]; infinity is a rest. Throws as follow().
  void step(const InputRef& input, double dt);

  int size() const { return static_cast<int>(states_.size()); }
  const ResponseState& state(int i) const { return states_[static_cast<std::size_t>(i)]; }
  /// Whether no actuator has a lag, play or slow state.
  bool instant() const;
  /// Whether effective() is independent of what came before the start.
  bool known() const;
  /// The longest Response::restTime() [s].
  double restTime() const;
  /// w (n) [Pa]. Of an actuator whose response is instant: its last input as it was, even NaN.
  const Eigen::VectorXd& effective() const { return effective_; }
  /// Largest error (n) of effective() from what is unknown of the start [Pa], if inputs have been
  /// within the arm's limits.
  Eigen::VectorXd uncertainty(const Arm& arm) const;

  /// The least and largest effective inputs (n) that inputs within the arm's limits reach from
  /// here, within those limits. @param lower, upper  (n).
  void effectiveLimits(const Arm& arm, Eigen::Ref<Eigen::VectorXd> lower,
                       Eigen::Ref<Eigen::VectorXd> upper,
                       AfterMove after = AfterMove::kSlowHeld) const noexcept;
  /// The effective inputs (n) of inputs that are reached in one direction from here.
  Eigen::VectorXd effectiveAt(const InputRef& input, AfterMove after = AfterMove::kSlowHeld) const;
  /// Inputs (n) within the arm's limits that, reached in one direction from here, have these
  /// effective ones.
  void inputsFor(const Arm& arm, const InputRef& effective, Eigen::Ref<Eigen::VectorXd> input,
                 AfterMove after = AfterMove::kSlowHeld) const noexcept;

 private:
  void requireSize(Eigen::Index count) const;
  void stepOne(Eigen::Index i, double input, double dt) noexcept;

  std::optional<Response> common_;
  std::vector<ResponseState> states_;
  ResponseShares shares_;
  std::vector<double> times_;  // of the last input of each actuator; NaN before one
  Eigen::VectorXd effective_;
};

}  // namespace helix_arm::model
