#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "cockpit_view.hpp"
#include "helix_arm/RunCalibrationResult.h"

namespace helix_arm::ros_bridge {

/// Answer to a call that a user asked for.
struct CallAnswer {
  std::string what;  ///< name of the call, such as "Enable"
  bool success = false;
  std::string message;      ///< of the service; or why there is no answer
  bool answered = true;     ///< false: nothing answered, so the call may or may not have arrived
  std::string remedy = {};  ///< what the user has to do where the call failed; empty: nothing
};

/// Calls services in threads of their own, so that whoever asks is never blocked, and gives up on
/// those that do not answer in time.
///
/// Calls do not wait for each other: a service that hangs delays no emergency stop. A call that was
/// given up on may still end later; its answer is then dropped.
class CallDesk {
 public:
  /// Makes the call in a thread of its own; what it throws is the answer.
  using Call = std::function<CallAnswer()>;
  /// Gets exactly one answer per call, from some thread, and none after the destructor of the desk.
  using Done = std::function<void(const CallAnswer&)>;

  /// At most so many calls of one name wait for an answer; further ones are refused. Those given up
  /// on do not count: a fifth emergency stop still goes out to a node that has come back.
  static constexpr int kMostWaiting = 4;
  /// At most so many calls of one name have a thread, with those that were given up on.
  static constexpr int kMostRunning = 64;

  explicit CallDesk(Done done);
  ~CallDesk();
  CallDesk(const CallDesk&) = delete;
  CallDesk& operator=(const CallDesk&) = delete;

  /// @param what     name of the call in its answer.
  /// @param limit    time in which it must answer, > 0 [s].
  /// @param call     Must not refer to anything that may end before it.
  /// @param remedy   of its answer, however the call fails.
  void ask(const std::string& what, double limit, Call call, const std::string& remedy = {});
  /// Whether a call of this name waits for its answer; one that was given up on does not.
  bool waits(const std::string& what) const;

 private:
  struct State;
  const std::shared_ptr<State> state_;
};

// What the cockpit says of an arm, and what it offers. No widget, no ROS: values in, words out.

/// How serious a text is; a widget gives it a colour.
enum class Tone : std::uint8_t { kQuiet, kGood, kCaution, kBad };

/// What remains to do where an emergency stop fails.
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
/// What to do next; and if that is to enable the arm, what prevents it now. Empty if neither is.
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
/// What is doubtful in the result of a calibration; empty if nothing is.
Words calibrationWarnings(const CockpitView& view);
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

/// Writes the last calibration of an arm's calibration node into its ~out_folder, under a name that
/// holds the time, and loads it in pressure_command, vision, visual_servo and calibration, those
/// that are up. Blocks.
///
/// @param ns  resolved namespace of the arm's nodes.
CallAnswer useLastCalibration(const std::string& ns);

}  // namespace helix_arm::ros_bridge
