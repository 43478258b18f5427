#pragma once

#include <cstdint>
#include <string>

#include "ros_bridge/cockpit/call_desk.hpp"
#include "ros_bridge/cockpit/cockpit_view.hpp"

/// What the cockpit says of an arm, and what it offers. No widget, no ROS: values in, words out.
namespace helix_arm::ros_bridge {

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

}  // namespace helix_arm::ros_bridge
