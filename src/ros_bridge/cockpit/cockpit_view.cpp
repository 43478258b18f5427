#include "cockpit_view.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include "basics/quote.hpp"
#include "basics/text.hpp"
#include "helix_arm/LoopStatus.h"
#include "procedures/calibration_job.hpp"
#include "ros_bridge/common/arm_markers.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr std::size_t kLongestText = 500;  // of another node
constexpr std::size_t kMostWarnings = 8;   // of a calibration

bool is(const CockpitView& view, const std::string& state) {
  return view.safety && view.safety->state == state;
}

std::string nodeOf(const CockpitView& view, const char* node) {
  return (view.ns == "/" ? "" : view.ns) + "/" + node;
}

std::string disconnected(const CockpitView& view) {
  if (view.ns.empty() && !view.silent_master.empty()) return masterWords(view);
  if (view.ns.empty() && !view.connecting_to.empty()) return "connects to " + view.connecting_to;
  if (view.ns.empty()) return "the namespace above is no name; correct it";
  return "no pressure_command comes from " + nodeOf(view, "pressure_command") +
         "; start the arm (arm.launch or demo.launch), or correct the namespace";
}

// Obstacle to every command of the arm; empty if nothing does.
std::string unheard(const CockpitView& view) {
  if (!view.connected) return disconnected(view);
  if (!view.safety) return "safety_state has not come yet";
  return {};
}

std::string notEnabled(const CockpitView& view) {
  std::string out = unheard(view);
  if (!out.empty() || is(view, SafetyState::ENABLED)) return out;
  if (view.safety->stopped) return "the emergency stop is engaged; release it, then enable the arm";
  return "the arm is " + view.safety->state + "; enable it first";
}

// Reason that keeps the cockpit from commanding the arm; empty if nothing does.
std::string notFree(const CockpitView& view) {
  const std::string out = notEnabled(view);
  if (!out.empty()) return out;
  if (view.calibration.running) return "a calibration commands the arm; cancel it first";
  return view.experiment.running ? "an experiment commands the arm; stop it first" : "";
}

// Whether an action of this node may run. @param article  of its run.
template <class Run>
Possibility mayRun(const CockpitView& view, const Run& run, const char* article,
                   const std::string& node) {
  if (!run.there) {
    return {"no " + node + " node is up; start arm.launch or demo.launch with calibration:=true"};
  }
  if (run.running) return {article + node + " runs already"};
  const std::string out = notFree(view);
  const bool holds = out.empty() && view.goal != CockpitGoal::kNone;
  return {holds ? "the cockpit holds the arm; let go of it first" : out};
}

constexpr double kHighest = 1e12;  // a value beyond it does not scale the axis

// @param values  of a row.
template <class Values>
double topOf(const std::deque<StripHistory::Row>& rows, double least, const Values& values) {
  double largest = 0, top = least;
  for (const StripHistory::Row& row : rows) {
    for (const double value : values(row)) {
      if (std::isfinite(value)) largest = std::max(largest, value);
    }
  }
  for (int k = 0; top < largest && top < kHighest; ++k) top *= k % 3 == 1 ? 2.5 : 2.0;
  return top;
}

constexpr double kFieldOfView = 0.785;  // of rviz, from bottom to top [rad]
constexpr double kDiscRadius = 0.1;     // of an arm's discs, in its lengths

}  // namespace

std::string armName(const CockpitView& view) {
  if (view.ns.empty()) return "no arm";
  return view.ns == "/" ? "/ (no namespace)" : view.ns;
}

std::string masterWords(const CockpitView& view) {
  return "the ROS master at " + view.silent_master + " does not answer; the panel connects to " +
         view.connecting_to + " once it does";
}

Headline headline(const CockpitView& view) {
  if (!view.connected) return {"NO CONNECTION", disconnected(view), "", Tone::kBad};
  if (!view.safety) return {"NO STATE", "safety_state has not come yet", "", Tone::kCaution};
  const SafetyState& safety = *view.safety;
  static const std::map<std::string, std::pair<const char*, Tone>> kStates = {
      {SafetyState::ENABLED, {"ENABLED", Tone::kGood}},
      {SafetyState::DISABLED, {"DISABLED", Tone::kQuiet}},
      {SafetyState::FAULT, {"FAULT", Tone::kBad}},
      {SafetyState::VENTED, {"VENTED", Tone::kCaution}}};
  const auto known = kStates.find(safety.state);
  Headline out{safety.state, safety.problem, safety.remedy, Tone::kCaution};
  if (known != kStates.end()) std::tie(out.state, out.tone) = known->second;
  if (is(view, SafetyState::ENABLED) && safety.resting) out.state += ", GOES TO REST";
  if (!safety.action.empty()) out.cause += (out.cause.empty() ? "" : ": ") + safety.action;
  if (safety.stopped) out.state = "STOPPED (" + out.state + ")";
  if (safety.stopped || safety.vent_overdue) out.tone = Tone::kBad;
  return out;
}

std::string remedyWords(const CockpitView& view) {
  const std::string remedy = headline(view).remedy;
  std::string out = remedy.empty() ? "" : "Next: " + remedy;
  if (!view.connected || is(view, SafetyState::ENABLED)) return out;
  const std::string why_not = mayEnable(view).why_not;
  if (why_not.empty()) return out;
  return out + (out.empty() ? "" : "\n") + "Enable: " + why_not;
}

Possibility mayEnable(const CockpitView& view) {
  if (const std::string out = unheard(view); !out.empty()) return {out};
  if (is(view, SafetyState::ENABLED)) return {"the arm is enabled already"};
  if (view.safety->stopped) return {"the emergency stop is engaged; release it first"};
  if (is(view, SafetyState::FAULT))
    return {"pressure remains after a fault; wait until the arm is vented"};
  for (const CockpitChannel& channel : view.channels) {
    if (std::isfinite(channel.measured)) continue;
    return {"no reading of " + channel.name + " is received; check the regulator and its node"};
  }
  return {};
}

Possibility mayVent(const CockpitView& view) { return {unheard(view)}; }

Possibility mayStop(const CockpitView& view) {
  const bool engaged = view.connected && view.safety && view.safety->stopped;
  return {engaged ? "the emergency stop is engaged" : ""};
}

Possibility mayRelease(const CockpitView& view) {
  if (const std::string out = unheard(view); !out.empty()) return {out};
  return {view.safety->stopped ? "" : "the emergency stop is not engaged"};
}

Possibility mayHold(const CockpitView& view) {
  if (view.goal != CockpitGoal::kNone) return {};
  if (const std::string out = notFree(view); !out.empty()) return {out};
  for (const CockpitChannel& channel : view.channels) {
    if (!std::isfinite(channel.command)) return {"the command of " + channel.name + " is unknown"};
  }
  return {};
}

Possibility maySetPressure(const CockpitView& view, const CockpitChannel& channel) {
  const std::string out = notFree(view);
  if (!out.empty() || channel.lower < channel.upper) return {out};
  return {"the limits of " + channel.name + " have not come yet (/diagnostics)"};
}

Possibility mayAimTip(const CockpitView& view) {
  const std::string out = notFree(view);
  if (!out.empty() || view.tip_heard) return {out};
  return {"no node takes tip targets; is visual_servo up, or pressure_command started without it?"};
}

Possibility mayCalibrate(const CockpitView& view) {
  return mayRun(view, view.calibration, "a ", "calibration");
}

Possibility mayCancel(const CockpitView& view) {
  return {view.calibration.running ? "" : "no calibration of this cockpit runs"};
}

Possibility mayExperiment(const CockpitView& view) {
  return mayRun(view, view.experiment, "an ", "experiment");
}

Possibility mayStopExperiment(const CockpitView& view) {
  return {view.experiment.running ? "" : "no experiment of this cockpit runs"};
}

Possibility mayUse(const CockpitView& view) {
  const CockpitCalibration& run = view.calibration;
  if (run.running) return {"the calibration has not ended"};
  if (!run.ended || !run.result.success) return {"there is no calibrated scene yet"};
  if (run.is_loaded) return {"the calibrated scene is being loaded"};
  return {unheard(view)};
}

Words answerWords(const CallAnswer& answer) {
  const char* const refused = answer.answered && !answer.success ? "refused: " : "";
  const std::string remedy = answer.remedy.empty() ? "" : answer.remedy + ": ";
  return {answer.what + ": " + remedy + refused + answer.message,
          answer.success ? Tone::kQuiet : Tone::kBad};
}

Words loopWords(const CockpitView& view) {
  if (!view.loop) return {"open: no visual_servo is up (closed_loop:=true)", Tone::kQuiet};
  static const std::map<std::string, Tone> kTones = {{LoopStatus::CLOSED, Tone::kGood},
                                                     {LoopStatus::COASTING, Tone::kCaution},
                                                     {LoopStatus::YIELDING, Tone::kCaution},
                                                     {LoopStatus::DIVERGING, Tone::kBad},
                                                     {LoopStatus::DOUBTFUL, Tone::kBad}};
  const CockpitLoop& loop = *view.loop;
  const auto tone = kTones.find(loop.state);
  Words out{loop.state, tone == kTones.end() ? Tone::kQuiet : tone->second};
  if (std::isfinite(loop.error)) out.text += ", " + millimetres(loop.error) + " from the target";
  if (loop.budget_sd > 0) {
    out.text += ", tip known to " + millimetres(loop.budget_sd);
  } else if (loop.predicted_sd > 0) {
    out.text += ", tip known to " + millimetres(loop.predicted_sd) + " if the tags are where the " +
                "scene says";
  }
  if (!loop.message.empty()) out.text += ": " + loop.message;
  return out;
}

Words calibrationWords(const CockpitView& view) {
  const CockpitCalibration& run = view.calibration;
  if (run.running) {
    const RunCalibrationFeedback& now = run.progress;
    if (now.steps == 0) return {"begins", Tone::kQuiet};
    return {basics::format("step %u of %u, %u samples: ", now.step, now.steps, now.samples) +
                shownText(now.state),
            Tone::kQuiet};
  }
  if (!run.ended) return {mayCalibrate(view).why_not, Tone::kQuiet};
  if (run.cancelled) return {"cancelled: the arm ramps down to rest", Tone::kCaution};
  const RunCalibrationResult& result = run.result;
  std::string text = shownText(result.message);
  if (!result.success) return {"failed: " + text, Tone::kBad};
  if (std::isfinite(result.tip_error_before) && std::isfinite(result.tip_error_after)) {
    text = "tip error " + millimetres(result.tip_error_before) + " before, " +
           millimetres(result.tip_error_after) + " after (median of the samples)";
  }
  for (const std::string& line : parameterLines(result)) text += "\n" + line;
  return {text, Tone::kGood};
}

Words calibrationWarnings(const CockpitView& view) {
  const CockpitCalibration& run = view.calibration;
  Words out{"", Tone::kCaution};
  if (run.running || !run.ended || !run.result.success) return out;
  const std::vector<std::string>& warnings = run.result.warnings;
  for (std::size_t i = 0; i < std::min(warnings.size(), kMostWarnings); ++i) {
    out.text += (out.text.empty() ? "" : "\n") + ("warning: " + shownText(warnings[i]));
  }
  return out;
}

Words experimentWords(const CockpitView& view) {
  const CockpitExperiment& run = view.experiment;
  if (run.running) {
    const RunExperimentFeedback& now = run.progress;
    if (now.doing.empty()) return {"begins", Tone::kQuiet};
    const double left = now.seconds_left;
    return {shownText(now.doing) + (left < 90 ? basics::format(", %.0f s left", left)
                                              : basics::format(", %.0f min left", left / 60)),
            Tone::kQuiet};
  }
  if (!run.ended) return {mayExperiment(view).why_not, Tone::kQuiet};
  const RunExperimentResult& result = run.result;
  std::string text = (result.success ? "" : "stopped: ") + shownText(result.message);
  if (!result.sheet.empty()) text += "\ndata sheet: " + shownText(result.sheet);
  const std::size_t count = std::min({result.names.size(), result.values.size(),
                                      result.standard_errors.size(), result.units.size()});
  for (std::size_t i = 0; i < count; ++i) {
    if (!std::isfinite(result.values[i])) continue;
    text += "\n" + shownText(result.names[i]) +
            basics::format(": %.4g +- %.2g ", result.values[i], result.standard_errors[i]) +
            shownText(result.units[i]);
  }
  return {text, result.success ? Tone::kGood : run.cancelled ? Tone::kCaution : Tone::kBad};
}

Words goalWords(const CockpitView& view) {
  const char* const held = view.goal == CockpitGoal::kPressures ? "holds the pressures"
                           : view.goal == CockpitGoal::kTip     ? "holds the tip target"
                                                                : "";
  Words out{held, view.refused ? Tone::kBad : view.short_of ? Tone::kCaution : Tone::kQuiet};
  if (!view.answer.empty()) {
    if (!out.text.empty()) out.text += ": ";
    out.text += view.answer;
  }
  if (out.text.empty()) {
    out.text = "commands nothing";
    if (std::isfinite(view.target_timeout)) {
      out.text += basics::format("; an arm without targets vents after %g s", view.target_timeout);
    }
  }
  return out;
}

std::string shownText(const std::string& text) { return basics::quoted(text, kLongestText); }

std::string kilopascals(double pascals) {
  if (!std::isfinite(pascals)) return "-";
  return basics::format("%.1f kPa", std::round(1e-2 * pascals) / 10 + 0.0);  // never "-0.0"
}

std::string limitWords(const CockpitChannel& channel) {
  if (!(channel.lower < channel.upper)) return "-";
  return basics::format("%.4g to %.4g", 1e-3 * channel.lower, 1e-3 * channel.upper);
}

std::string millimetres(double metres) {
  if (!std::isfinite(metres)) return "-";
  return basics::format("%.2f mm", 1e3 * metres);
}

std::string placeWords(const std::optional<std::vector<double>>& position) {
  if (!position || position->size() != 3) return "-";
  // Never "-0.0".
  const auto shown = [](double metres) { return std::round(1e4 * metres) / 10 + 0.0; };
  const std::vector<double>& p = *position;
  return basics::format("%.1f, %.1f, %.1f mm", shown(p[0]), shown(p[1]), shown(p[2]));
}

std::vector<std::string> parameterLines(const RunCalibrationResult& result) {
  const std::size_t count =
      std::min({result.names.size(), result.units.size(), result.initial.size(),
                result.values.size(), result.standard_errors.size(), result.identifiable.size()});
  std::vector<std::string> out;
  std::set<std::string> tags;
  std::string zeros;
  bool base = false;
  for (std::size_t i = 0; i < count; ++i) {
    if (!result.identifiable[i]) continue;
    const std::string& name = result.names[i];
    const double value = result.values[i], error = result.standard_errors[i];
    if (name.compare(0, 5, "base_") == 0) {
      base = true;
    } else if (name.compare(0, 4, "tag_") == 0) {
      tags.insert(name.substr(0, name.find('_', 4)));
    } else if (result.initial[i] == 0 && std::abs(value) < error) {
      zeros += (zeros.empty() ? "" : ", ") + shownText(name);
    } else {
      const std::string unit = result.units[i].empty() ? "" : " " + shownText(result.units[i]);
      out.push_back(shownText(name) +
                    basics::format(" %.4g -> %.4g +- %.2g", result.initial[i], value, error) +
                    unit);
    }
  }
  for (std::string& text : procedures::placementTexts(base, tags.size())) {
    out.push_back(std::move(text));
  }
  if (!zeros.empty()) out.push_back("not distinguishable from 0: " + zeros);
  return out;
}

void StripHistory::add(double time, const std::vector<double>& pressures, double tip_error) {
  if (!std::isfinite(time)) return;
  if (!rows_.empty()) {
    const Row& last = rows_.back();
    const bool anew = time < last.time || last.pressures.size() != pressures.size();
    if (!anew && time - last.time < period_) return;
    if (anew) rows_.clear();
  }
  rows_.push_back({time, pressures, tip_error});
  while (rows_.front().time < time - span_) rows_.pop_front();
}

double StripHistory::pressureTop(double least) const {
  return topOf(rows_, least, [](const Row& row) { return row.pressures; });
}

double StripHistory::errorTop(double least) const {
  return topOf(rows_, least, [](const Row& row) { return std::array{row.tip_error}; });
}

bool isToChange(const ArmCamera& camera, const std::string& base_frame) {
  if (camera.target == base_frame) return camera.focus.isZero(0);
  return camera.target == names::kBaseFrame;
}

ArmCamera changed(ArmCamera camera, const std::string& base_frame, const Eigen::Vector3d& axis,
                  double length, double aspect) {
  camera.target = base_frame;
  if (!camera.focus.isZero(0)) return camera;
  const SideView side = sideView(axis, length, kDiscRadius * length);
  camera.focus = side.centre;
  camera.yaw = side.yaw;
  camera.pitch = side.pitch;
  camera.distance = side.distance(kFieldOfView, aspect);
  return camera;
}

}  // namespace helix_arm::ros_bridge
