#pragma once

#include <cstdint>
#include <deque>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace helix_arm::ros_bridge {

inline constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

/// One actuator as the cockpit shows it. NaN where unknown.
struct CockpitChannel {
  std::string name;
  double command = kUnknown;   ///< set point in force, gauge [Pa]
  double measured = kUnknown;  ///< reading, gauge [Pa]
  double lower = kUnknown;     ///< limits of the command, gauge [Pa]
  double upper = kUnknown;
};

/// safety_state.
struct CockpitSafety {
  std::string state;  ///< disabled, enabled, fault or vented
  std::string cause;  ///< none, stale_target, ...
  std::string problem, action, remedy;
  std::string reason;  ///< all of it in a line
  bool resting = false;
  bool stopped = false;
  bool vent_overdue = false;
};

/// loop_status of visual_servo.
struct CockpitLoop {
  std::string state, message;
  double error = kUnknown;  ///< distance of the measured from the wanted tip [m]
  double predicted_sd =
      kUnknown;                 ///< of the loop's tip, with tags and base where the scene says [m]
  double budget_sd = kUnknown;  ///< the same with their uncertain placement [m]
};

/// What the cockpit itself commands.
enum class CockpitGoal : std::uint8_t { kNone, kPressures, kTip };

/// The run and the result of ~run_calibration.
struct CockpitCalibration {
  bool there = false;  ///< the action's server is connected
  bool running = false;
  bool is_loaded = false;  ///< the calibrated scene is being saved and loaded
  std::uint32_t step = 0, steps = 0, samples = 0;
  std::string state;  ///< phase of the run, and what it waits for
  bool ended = false;
  bool success = false;
  bool cancelled = false;
  std::string message;  ///< of the result
  /// Median tip error of the samples with the present scene and with the calibrated one [m].
  double tip_error_before = kUnknown, tip_error_after = kUnknown;
  std::vector<std::string> parameters;  ///< one line per determined parameter
  std::vector<std::string> warnings;
};

/// All that the cockpit shows of one arm, at one moment.
struct CockpitView {
  std::string ns;                ///< resolved namespace of the arm, such as / or /left
  std::string connecting_to;     ///< that of the arm to which a connection is made; empty: none
  std::string silent_master;     ///< URI of the ROS master if it lets that connection wait
  std::string base_frame;        ///< tf frame of the arm's base; empty if unknown
  double arm_length = kUnknown;  ///< of the model when it was first seen [m]
  bool connected = false;        ///< pressure_command comes
  bool tip_heard = true;         ///< a node takes tip targets
  std::optional<CockpitSafety> safety;
  std::vector<CockpitChannel> channels;             ///< in scene order
  std::optional<std::vector<double>> measured_tip;  ///< x, y, z, base frame [m]; fresh
  std::optional<std::vector<double>> model_tip;     ///< likewise
  double tip_error = kUnknown;                      ///< measured minus model [m]
  std::optional<CockpitLoop> loop;                  ///< if visual_servo is up
  CockpitGoal goal = CockpitGoal::kNone;            ///< what is held
  std::vector<double> held;                         ///< the held pressures, in scene order [Pa]
  std::string answer;                ///< to the cockpit's targets; or why it commands no longer
  bool refused = false;              ///< the last target was dropped
  bool short_of = false;             ///< the last target is out of reach
  double target_timeout = kUnknown;  ///< without targets for so long, the arm vents [s]; inf: never
  CockpitCalibration calibration;
};

/// The last seconds of some values, for a strip chart. NaN where a value was unknown.
class StripHistory {
 public:
  struct Row {
    double time;                    ///< [s]
    std::vector<double> pressures;  ///< gauge [Pa]
    double tip_error;               ///< [m]
  };

  /// @param span    time that is kept, > 0 [s].
  /// @param period  rows that come sooner after the last one are left out, >= 0 [s].
  /// @throws std::invalid_argument naming the value and its rule.
  StripHistory(double span, double period);

  /// A time before the last one, or another number of pressures, begins anew.
  void add(double time, const std::vector<double>& pressures, double tip_error);
  void clear() { rows_.clear(); }

  const std::deque<Row>& rows() const { return rows_; }
  double span() const { return span_; }
  double newest() const { return rows_.empty() ? 0.0 : rows_.back().time; }
  /// Upper end of the axes: the smallest of 1, 2, 5, 10, 20, .. times `least` that holds all
  /// values.
  double pressureTop(double least) const;
  double errorTop(double least) const;

 private:
  double span_, period_;
  std::deque<Row> rows_;
};

}  // namespace helix_arm::ros_bridge
