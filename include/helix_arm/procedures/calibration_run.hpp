#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "helix_arm/procedures/settle_watch.hpp"

namespace helix_arm::procedures {

/// Rules of a calibration run.
struct RunRules {
  static constexpr int kMaxCaptures = 5;

  int captures = 3;      ///< pictures of the arm at rest at each pressure, 1 to kMaxCaptures
  double ramp = 1e5;     ///< maximum rate of change of a pressure, > 0 [Pa/s]
  double patience = 30;  ///< longest wait for each capture, and for pictures on a ramp, > 0 [s]

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

enum class RunPhase {
  kRamping,    ///< to the pressures of the step
  kSettling,   ///< waiting until they and the shape are at rest, then taking captures
  kReturning,  ///< down to rest
  kEnded,
};
enum class RunEnd {
  kCompleted,  ///< all captures were taken
  kPreempted,  ///< it was asked to end
  kAborted,    ///< a fault occurred
};
/// "ramping", "settling", "returning" or "ended".
const char* nameOf(RunPhase phase);

/// Steps an arm through a plan of pressures and decides when to capture it. While pictures are
/// missing, the pressures stand still; the run aborts after its patience. It ramps the pressures
/// down to rest before it ends, except after yield(). Time is an argument.
class CalibrationRun {
 public:
  /// What to do now.
  struct Order {
    Eigen::VectorXd pressure;       ///< (actuators) to command [Pa]
    std::optional<Sample> capture;  ///< sample to keep
    bool step_done = false;         ///< it is the last one of its step
  };

  /// @param plan  (steps x actuators) [Pa], at least one step.
  /// @param from  (actuators) the command in force [Pa].
  /// @param rest  (actuators) final pressures [Pa].
  /// @throws std::invalid_argument naming the value and its rule.
  CalibrationRun(Eigen::MatrixXd plan, Eigen::VectorXd from, Eigen::VectorXd rest,
                 const RunRules& rules);

  /// @param now       monotonic time, on the clock of the stamps [s].
  /// @param settling  state of the arm at `now`; stale pressures abort the run.
  Order advance(double now, const Settling& settling);

  /// Ramps down and ends. The first of several reasons is kept, except completion.
  void end(RunEnd verdict, const std::string& reason);
  /// Ends without ramping, because another commander has the arm.
  void yield(const std::string& reason);

  RunPhase phase() const { return phase_; }
  /// Whether it waits for pictures that are missing.
  bool waitsForPictures() const { return unseen_since_.has_value(); }
  bool ended() const { return phase_ == RunPhase::kEnded; }
  int step() const { return step_; }  ///< counted from 0
  int steps() const { return static_cast<int>(plan_.rows()); }
  int captures() const { return captures_; }  ///< of this step, so far
  /// Valid once it is returning or has ended.
  RunEnd verdict() const { return verdict_; }
  const std::string& reason() const { return reason_; }

 private:
  bool rampTo(const Eigen::VectorXd& target, double dt);
  bool obeys(const Settling& settling) const;
  void watchPictures(double now, const Settling& settling);
  void lookAt(double now, const Settling& settling, Order& order);

  Eigen::MatrixXd plan_;
  Eigen::VectorXd pressure_;  ///< commanded [Pa]
  Eigen::VectorXd rest_;
  RunRules rules_;
  RunPhase phase_ = RunPhase::kRamping;
  int step_ = 0;
  int captures_ = 0;
  std::optional<double> last_time_;
  double settling_since_ = 0;
  std::optional<double> unseen_since_;  ///< while ramping or settling
  std::optional<double> returned_at_;   ///< time when the ramp down was over
  double last_capture_ = 0;             ///< stamp of its picture
  RunEnd verdict_ = RunEnd::kCompleted;
  std::string reason_;
};

}  // namespace helix_arm::procedures
