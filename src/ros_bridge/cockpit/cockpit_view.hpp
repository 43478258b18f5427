#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <deque>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/RunCalibrationFeedback.h"
#include "helix_arm/RunCalibrationResult.h"
#include "helix_arm/RunExperimentFeedback.h"
#include "helix_arm/RunExperimentResult.h"
#include "helix_arm/SafetyState.h"

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

/// loop_status of visual_servo.
struct CockpitLoop {
  std::string state, message;
  double error = kUnknown;  ///< distance of the measured from the wanted tip [m]
  /// Standard deviation of the loop's tip, with tags and base where the scene says [m].
  double predicted_sd = kUnknown;
  double budget_sd = kUnknown;  ///< the same with their uncertain placement [m]
};

/// Kind of command of the cockpit itself.
enum class CockpitGoal : std::uint8_t { kNone, kPressures, kTip };

/// The target that it holds, and the fate of its targets.
struct CockpitHold {
  CockpitGoal goal = CockpitGoal::kNone;
  std::vector<double> held;     ///< pressures in scene order, gauge [Pa]
  std::array<double, 3> tip{};  ///< base frame [m]
  std::string answer;           ///< to the targets; or why it commands no longer
  bool refused = false;         ///< the last target was dropped
  bool short_of = false;        ///< the last target is out of reach
};

/// The run and the result of an action.
template <class Feedback, class Result>
struct CockpitRun {
  bool there = false;  ///< the action's server is connected
  bool running = false;
  bool ended = false;
  bool cancelled = false;
  Feedback progress;
  Result result;  ///< or without one, why
};
/// Run of ~run_calibration.
struct CockpitCalibration : CockpitRun<RunCalibrationFeedback, RunCalibrationResult> {
  bool is_loaded = false;  ///< the calibrated scene is being saved and loaded
};
/// Run of ~run_experiment.
using CockpitExperiment = CockpitRun<RunExperimentFeedback, RunExperimentResult>;

/// All that the cockpit shows of one arm, at one moment.
struct CockpitView : CockpitHold {
  std::string ns;                ///< resolved namespace of the arm, such as / or /left
  std::string connecting_to;     ///< that of the arm to which a connection is made; empty: none
  std::string silent_master;     ///< URI of the ROS master if it lets that connection wait
  std::string base_frame;        ///< tf frame of the arm's base; empty if unknown
  double arm_length = kUnknown;  ///< of the model [m]
  bool connected = false;        ///< pressure_command comes
  bool tip_heard = true;         ///< a node takes tip targets
  std::optional<SafetyState> safety;
  std::vector<CockpitChannel> channels;             ///< in scene order
  std::optional<std::vector<double>> measured_tip;  ///< x, y, z, base frame [m]; fresh
  std::optional<std::vector<double>> model_tip;     ///< likewise
  double tip_error = kUnknown;                      ///< measured minus model [m]
  std::optional<CockpitLoop> loop;                  ///< if visual_servo is up
  double target_timeout = kUnknown;  ///< without targets for so long, the arm vents [s]; inf: never
  CockpitCalibration calibration;
  CockpitExperiment experiment;
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
  StripHistory(double span, double period) : span_(span), period_(period) {}

  /// A time before the last one, or another number of pressures, begins anew.
  void add(double time, const std::vector<double>& pressures, double tip_error);
  void clear() { rows_.clear(); }

  const std::deque<Row>& rows() const { return rows_; }
  double newest() const { return rows_.empty() ? 0.0 : rows_.back().time; }
  /// Upper end of the axes: the smallest of 1, 2, 5, 10, 20, .. times `least` that holds all
  /// values.
  double pressureTop(double least) const;
  double errorTop(double least) const;

 private:
  const double span_, period_;
  std::deque<Row> rows_;
};

/// Answer to a call that a user asked for.
struct CallAnswer {
  std::string what;  ///< name of the call, such as "Enable"
  bool success = false;
  std::string message;      ///< of the service; or why there is no answer
  bool answered = true;     ///< false: nothing answered, so the call may or may not have arrived
  std::string remedy = {};  ///< what the user has to do where the call failed; empty: nothing
};

// Words of the cockpit about an arm, and its offers. No widget, no ROS: values in, words out.

/// How serious a text is; a widget gives it a colour.
enum class Tone : std::uint8_t { kQuiet, kGood, kCaution, kBad };

/// The last resort where an emergency stop fails.
inline constexpr char kStopByHand[] = "shut the supply and open the relief valve by hand";

/// The arm that the buttons command: its resolved namespace, or that there is none.
std::string armName(const CockpitView& view);

/// State, cause and remedy of the arm in words.
struct Headline {
  std::string state;   ///< one or two words
  std::string cause;   ///< empty if nothing is wrong
  std::string remedy;  ///< what to do next
  Tone tone = Tone::kQuiet;
};
Headline headline(const CockpitView& view);
/// The next thing to do; and if that is to enable the arm, what prevents it now. Empty if neither
/// is.
std::string remedyWords(const CockpitView& view);

/// That a ROS master which does not answer prevents the connection to an arm.
std::string masterWords(const CockpitView& view);

/// Whether an action is possible now; if not, why not, and what makes it possible.
struct Possibility {
  std::string why_not;  ///< empty if it is possible
  bool possible() const { return why_not.empty(); }
};
Possibility mayEnable(const CockpitView& view);
Possibility mayVent(const CockpitView& view);
/// The emergency stop is offered always, except where it is engaged already.
Possibility mayStop(const CockpitView& view);
Possibility mayRelease(const CockpitView& view);
Possibility mayHold(const CockpitView& view);
Possibility maySetPressure(const CockpitView& view, const CockpitChannel& channel);
Possibility mayAimTip(const CockpitView& view);
Possibility mayCalibrate(const CockpitView& view);
Possibility mayCancel(const CockpitView& view);
Possibility mayExperiment(const CockpitView& view);
Possibility mayStopExperiment(const CockpitView& view);
Possibility mayUse(const CockpitView& view);

/// A line with its tone.
struct Words {
  std::string text;
  Tone tone = Tone::kQuiet;
};
/// Answer to a call; what the user has to do comes first.
Words answerWords(const CallAnswer& answer);
Words loopWords(const CockpitView& view);
Words calibrationWords(const CockpitView& view);
/// Doubts about the result of a calibration; empty if there are none.
Words calibrationWarnings(const CockpitView& view);
/// Progress and time left; or the figures and the path of the data sheet.
Words experimentWords(const CockpitView& view);
/// Answer to the cockpit's own targets, and what it holds.
Words goalWords(const CockpitView& view);

/// Text of another node, without control characters and shortened.
std::string shownText(const std::string& text);
/// "123.4 kPa"; "-" if unknown.
std::string kilopascals(double pascals);
/// "0 to 413.7", in kPa; "-" if unknown.
std::string limitWords(const CockpitChannel& channel);
/// "12.34 mm"; "-" if unknown.
std::string millimetres(double metres);
/// "1.2, -3.4, 0.0 mm" of a position in metres; "-" if unknown.
std::string placeWords(const std::optional<std::vector<double>>& position);

/// One line per parameter that the data determined: name, value before and after, standard error.
/// As in the result's message, one line stands for the pose of the base and one for all tags.
/// Parameters that began at 0 and are smaller than their standard error share the last line.
std::vector<std::string> parameterLines(const RunCalibrationResult& result);

/// A camera of rviz that orbits, as its properties tell.
struct ArmCamera {
  std::string target;                               ///< frame whose origin it follows
  Eigen::Vector3d focus = Eigen::Vector3d::Zero();  ///< from there, axes of the fixed frame [m]
  double yaw = 0.0, pitch = 0.0;                    ///< [rad]
  double distance = 0.0;                            ///< of the eye from the focus [m]
};

/// Whether the cockpit of an arm changes this view. It does while the view looks at arm_base, the
/// frame of an arm without a prefix and of rviz configurations that know no arm; or exactly at the
/// base of this arm. A view of another arm, or one that a user moved there, stays.
bool isToChange(const ArmCamera& camera, const std::string& base_frame);

/// The same view at the base of this arm: if it looked exactly at a base, it shows all of the arm
/// from its side; otherwise its focus, angles and distance stay.
/// @param base_frame  of the arm.
/// @param axis        in which the arm leaves its base, fixed frame.
/// @param length      of the arm, > 0 [m].
/// @param aspect      width by height of the picture.
ArmCamera changed(ArmCamera camera, const std::string& base_frame, const Eigen::Vector3d& axis,
                  double length, double aspect);

}  // namespace helix_arm::ros_bridge
