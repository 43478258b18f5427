#include "cockpit_words.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <exception>
#include <map>
#include <set>
#include <system_error>
#include <thread>

#include <ros/names.h>
#include <ros/param.h>
#include <ros/service.h>

#include "helix_arm/Reload.h"
#include "helix_arm/Save.h"
#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/procedures/calibration_job.hpp"
#include "helix_arm/procedures/calibration_words.hpp"
#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

using Clock = std::chrono::steady_clock;

CallAnswer noAnswer(const std::string& what, const std::string& why) {
  return {what, false, why, false};
}

constexpr char kDisabled[] = "disabled";
constexpr char kEnabled[] = "enabled";
constexpr char kFault[] = "fault";
constexpr char kVented[] = "vented";
constexpr std::size_t kLongestText = 500;  // of another node

bool is(const CockpitView& view, const char* state) {
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

// What stands in the way of every command of the arm; empty if nothing does.
std::string unheard(const CockpitView& view) {
  if (!view.connected) return disconnected(view);
  if (!view.safety) return "safety_state has not come yet";
  return {};
}

std::string notEnabled(const CockpitView& view) {
  std::string out = unheard(view);
  if (!out.empty() || is(view, kEnabled)) return out;
  if (view.safety->stopped) return "the emergency stop is engaged; release it, then enable the arm";
  return "the arm is " + view.safety->state + "; enable it first";
}

bool calibrates(const CockpitView& view) { return view.calibration.running; }

template <class... Arguments>
std::string format(const char* pattern, Arguments... arguments) {
  char text[400];
  std::snprintf(text, sizeof text, pattern, arguments...);
  return text;
}

// Of a file: digits and T, Z alone.
std::string timeStamp() {
  std::string out = procedures::utcNow();
  out.erase(
      std::remove_if(out.begin(), out.end(), [](unsigned char c) { return std::isalnum(c) == 0; }),
      out.end());
  return out;
}

}  // namespace

// Shared with the threads of the calls, which may outlive the desk.
struct CallDesk::State {
  struct Waiting {
    std::string what, remedy;
    double limit;
    Clock::time_point due;
  };

  explicit State(Done done) : done_(std::move(done)) {}

  /// Registers a call, unless too many of its name have not ended; then it is answered.
  bool begin(const std::string& what, double limit, const std::string& remedy,
             std::uint64_t& ticket) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    const auto waiting = count(what);
    if (waiting >= kMostWaiting || running_[what] >= kMostRunning) {
      tell(noAnswer(what, waiting >= kMostWaiting
                              ? "earlier calls still wait for their answers; is the node alive?"
                              : "too many calls hang; end the node that hangs"),
           remedy);
      return false;
    }
    ++running_[what];
    ticket = ++last_ticket_;
    const auto time =
        std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(limit));
    waiting_.emplace(ticket, Waiting{what, remedy, limit, Clock::now() + time});
    changed_.notifyAll();
    return true;
  }

  /// The call has ended; its answer counts unless it was given up on.
  void end(std::uint64_t ticket, const CallAnswer& answer) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    --running_[answer.what];
    const auto call = waiting_.extract(ticket);
    if (call) tell(answer, call.mapped().remedy);
  }

  bool waits(const std::string& what) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    return count(what) > 0;
  }

  void close() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    closed_ = true;
    changed_.notifyAll();
  }

  /// Gives up on the calls that are late, until the desk is closed.
  void watch() HELIX_ARM_EXCLUDES(mutex_) {
    basics::MutexLock lock(mutex_);
    while (!closed_) {
      const Clock::time_point now = Clock::now();
      Clock::time_point next = now + std::chrono::hours(1);
      for (auto it = waiting_.begin(); it != waiting_.end();) {
        if (it->second.due > now) {
          next = std::min(next, it->second.due);
          ++it;
          continue;
        }
        char text[120];
        std::snprintf(text, sizeof text, "no answer within %g s; is the node alive?",
                      it->second.limit);
        tell(noAnswer(it->second.what, text), it->second.remedy);
        it = waiting_.erase(it);
      }
      const std::uint64_t seen = last_ticket_;
      changed_.waitUntil(lock, next, [this, seen]() HELIX_ARM_REQUIRES(mutex_) {
        return closed_ || last_ticket_ != seen;
      });
    }
  }

 private:
  std::ptrdiff_t count(const std::string& what) const HELIX_ARM_REQUIRES(mutex_) {
    return std::count_if(waiting_.begin(), waiting_.end(),
                         [&](const auto& one) { return one.second.what == what; });
  }

  // With the lock, so that nothing is told once the desk is closed.
  void tell(CallAnswer answer, const std::string& remedy) HELIX_ARM_REQUIRES(mutex_) {
    if (!answer.success) answer.remedy = remedy;
    if (!closed_) done_(answer);
  }

  const Done done_;
  basics::Mutex mutex_;
  basics::Condition changed_;
  bool closed_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  std::uint64_t last_ticket_ HELIX_ARM_GUARDED_BY(mutex_) = 0;
  std::map<std::uint64_t, Waiting> waiting_ HELIX_ARM_GUARDED_BY(mutex_);
  std::map<std::string, int> running_ HELIX_ARM_GUARDED_BY(mutex_);  ///< also those given up on
};

CallDesk::CallDesk(Done done) : state_(std::make_shared<State>(std::move(done))) {
  std::thread([state = state_] { state->watch(); }).detach();
}

CallDesk::~CallDesk() { state_->close(); }

void CallDesk::ask(const std::string& what, double limit, Call call, const std::string& remedy) {
  std::uint64_t ticket = 0;
  if (!state_->begin(what, limit, remedy, ticket)) return;
  const auto run = [state = state_, what, ticket, call = std::move(call)] {
    CallAnswer answer;
    try {
      answer = call();
    } catch (const std::exception& fault) {
      answer = noAnswer(what, fault.what());
    }
    answer.what = what;
    state->end(ticket, answer);
  };
  try {
    // Detached: nothing ends a call to a service that neither answers nor hangs up.
    std::thread(run).detach();
  } catch (const std::system_error& fault) {
    state_->end(ticket, noAnswer(what, std::string("no thread for it: ") + fault.what()));
  }
}

bool CallDesk::waits(const std::string& what) const { return state_->waits(what); }

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
  const CockpitSafety& safety = *view.safety;
  Headline out;
  out.cause = safety.problem;
  if (!safety.action.empty()) out.cause += (out.cause.empty() ? "" : ": ") + safety.action;
  out.remedy = safety.remedy;
  if (safety.state == kEnabled) {
    out.state = safety.resting ? "ENABLED, GOES TO REST" : "ENABLED";
    out.tone = Tone::kGood;
  } else if (safety.state == kDisabled) {
    out.state = "DISABLED";
    out.tone = Tone::kQuiet;
  } else if (safety.state == kFault) {
    out.state = "FAULT";
    out.tone = Tone::kBad;
  } else if (safety.state == kVented) {
    out.state = "VENTED";
    out.tone = Tone::kCaution;
  } else {
    out.state = safety.state;
    out.tone = Tone::kCaution;
  }
  if (safety.stopped) {
    out.state = "STOPPED (" + out.state + ")";
    out.tone = Tone::kBad;
  }
  if (safety.vent_overdue) out.tone = Tone::kBad;
  return out;
}

std::string remedyWords(const CockpitView& view) {
  const std::string remedy = headline(view).remedy;
  std::string out = remedy.empty() ? "" : "Next: " + remedy;
  if (!view.connected || is(view, kEnabled)) return out;
  const std::string why_not = mayEnable(view).why_not;
  if (why_not.empty()) return out;
  return out + (out.empty() ? "" : "\n") + "Enable: " + why_not;
}

Possibility mayEnable(const CockpitView& view) {
  const std::string out = unheard(view);
  if (!out.empty()) return {out};
  if (is(view, kEnabled)) return {"the arm is enabled already"};
  if (view.safety->stopped) return {"the emergency stop is engaged; release it first"};
  if (is(view, kFault)) return {"pressure remains after a fault; wait until the arm is vented"};
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
  const std::string out = unheard(view);
  if (!out.empty()) return {out};
  return {view.safety->stopped ? "" : "the emergency stop is not engaged"};
}

Possibility mayHold(const CockpitView& view) {
  if (view.goal != CockpitGoal::kNone) return {};
  const std::string out = notEnabled(view);
  if (!out.empty()) return {out};
  if (calibrates(view)) return {"a calibration commands the arm; cancel it first"};
  for (const CockpitChannel& channel : view.channels) {
    if (!std::isfinite(channel.command)) return {"the command of " + channel.name + " is unknown"};
  }
  return {};
}

Possibility maySetPressure(const CockpitView& view, const CockpitChannel& channel) {
  const std::string out = notEnabled(view);
  if (!out.empty()) return {out};
  if (calibrates(view)) return {"a calibration commands the arm; cancel it first"};
  if (!(channel.lower < channel.upper)) {
    return {"the limits of " + channel.name + " have not come yet (/diagnostics)"};
  }
  return {};
}

Possibility mayAimTip(const CockpitView& view) {
  const std::string out = notEnabled(view);
  if (!out.empty()) return {out};
  if (calibrates(view)) return {"a calibration commands the arm; cancel it first"};
  if (view.tip_heard) return {};
  return {"no node takes tip targets; is visual_servo up, or pressure_command started without it?"};
}

Possibility mayCalibrate(const CockpitView& view) {
  if (!view.calibration.there) {
    return {"no calibration node is up; start arm.launch or demo.launch with calibration:=true"};
  }
  if (calibrates(view)) return {"a calibration runs already"};
  const std::string out = notEnabled(view);
  if (!out.empty()) return {out};
  if (view.goal != CockpitGoal::kNone) return {"the cockpit holds the arm; let go of it first"};
  return {};
}

Possibility mayCancel(const CockpitView& view) {
  return {calibrates(view) ? "" : "no calibration of this cockpit runs"};
}

Possibility mayUse(const CockpitView& view) {
  const CockpitCalibration& run = view.calibration;
  if (calibrates(view)) return {"the calibration has not ended"};
  if (!run.ended || !run.success) return {"there is no calibrated scene yet"};
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
  const CockpitLoop& loop = *view.loop;
  Words out{loop.state, Tone::kQuiet};
  if (std::isfinite(loop.error)) out.text += ", " + millimetres(loop.error) + " from the target";
  if (loop.budget_sd > 0) {
    out.text += ", tip known to " + millimetres(loop.budget_sd);
  } else if (loop.predicted_sd > 0) {
    out.text += ", tip known to " + millimetres(loop.predicted_sd) + " if the tags are where the " +
                "scene says";
  }
  if (!loop.message.empty()) out.text += ": " + loop.message;
  if (loop.state == "closed") out.tone = Tone::kGood;
  if (loop.state == "coasting" || loop.state == "yielding") out.tone = Tone::kCaution;
  if (loop.state == "diverging" || loop.state == "doubtful") out.tone = Tone::kBad;
  return out;
}

Words calibrationWords(const CockpitView& view) {
  const CockpitCalibration& run = view.calibration;
  if (run.running) {
    if (run.steps == 0) return {"begins", Tone::kQuiet};
    return {format("step %u of %u, %u samples: ", run.step, run.steps, run.samples) + run.state,
            Tone::kQuiet};
  }
  if (!run.ended) return {mayCalibrate(view).why_not, Tone::kQuiet};
  if (run.cancelled) return {"cancelled: the arm ramps down to rest", Tone::kCaution};
  if (!run.success) return {"failed: " + run.message, Tone::kBad};
  std::string text;
  if (std::isfinite(run.tip_error_before) && std::isfinite(run.tip_error_after)) {
    text = "tip error " + millimetres(run.tip_error_before) + " before, " +
           millimetres(run.tip_error_after) + " after (median of the samples)";
  } else {
    text = run.message;
  }
  for (const std::string& line : run.parameters) text += "\n" + line;
  return {text, Tone::kGood};
}

Words calibrationWarnings(const CockpitView& view) {
  const CockpitCalibration& run = view.calibration;
  Words out{"", Tone::kCaution};
  if (run.running || !run.ended || !run.success) return out;
  for (const std::string& line : run.warnings) {
    out.text += (out.text.empty() ? "" : "\n") + ("warning: " + line);
  }
  return out;
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
      out.text += format("; an arm without targets vents after %g s", view.target_timeout);
    }
  }
  return out;
}

std::string shownText(const std::string& text) { return basics::quoted(text, kLongestText); }

std::string kilopascals(double pascals) {
  if (!std::isfinite(pascals)) return "-";
  return format("%.1f kPa", std::round(1e-2 * pascals) / 10 + 0.0);  // never "-0.0"
}

std::string limitWords(const CockpitChannel& channel) {
  if (!(channel.lower < channel.upper)) return "-";
  return format("%.4g to %.4g", 1e-3 * channel.lower, 1e-3 * channel.upper);
}

std::string millimetres(double metres) {
  if (!std::isfinite(metres)) return "-";
  return format("%.2f mm", 1e3 * metres);
}

std::string placeWords(const std::optional<std::vector<double>>& position) {
  if (!position || position->size() != 3) return "-";
  std::array<double, 3> shown{};
  for (std::size_t i = 0; i < 3; ++i) {
    shown[i] = std::round(1e4 * (*position)[i]) / 10 + 0.0;  // never "-0.0"
  }
  return format("%.1f, %.1f, %.1f mm", shown[0], shown[1], shown[2]);
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
      char numbers[120];
      std::snprintf(numbers, sizeof numbers, " %.4g -> %.4g +- %.2g", result.initial[i], value,
                    error);
      const std::string unit = result.units[i].empty() ? "" : " " + shownText(result.units[i]);
      out.push_back(shownText(name) + numbers + unit);
    }
  }
  for (std::string& text : procedures::placementTexts(base, tags.size())) {
    out.push_back(std::move(text));
  }
  if (!zeros.empty()) out.push_back("not distinguishable from 0: " + zeros);
  return out;
}

CallAnswer useLastCalibration(const std::string& ns) {
  CallAnswer out;
  const std::string node = ros::names::append(ns, names::kCalibrationNode);
  std::string folder;
  ros::param::get(ros::names::append(node, "out_folder"), folder);
  if (folder.empty()) ros::param::get(ros::names::append(node, "data_folder"), folder);
  if (folder.empty()) folder = defaultFolder();
  Save save;
  save.request.path = folder + "/calibrated_" + timeStamp() + ".yaml";
  const std::string save_name = ros::names::append(node, names::kSave);
  if (!ros::service::call(save_name, save)) {
    out.message = save_name + " is not there or does not answer";
    out.answered = false;
    return out;
  }
  if (!save.response.success) {
    out.message = "not written: " + shownText(save.response.message);
    return out;
  }
  std::string users;
  for (const char* user : {names::kPressureCommandNode, names::kVisionNode, names::kVisualServoNode,
                           names::kCalibrationNode}) {
    const std::string name = ros::names::append(ros::names::append(ns, user), names::kReload);
    if (!ros::service::exists(name, false)) continue;
    Reload reload;
    reload.request.scene = save.request.path;
    const bool called = ros::service::call(name, reload);
    if (!called || !reload.response.success) {
      out.message = save.request.path + (users.empty() ? "" : " is used by " + users + ", but") +
                    " is not loaded by " + user + ": " +
                    (called ? shownText(reload.response.message) : "no answer");
      return out;
    }
    users += (users.empty() ? "" : ", ") + std::string(user);
  }
  out.success = !users.empty();
  out.message = out.success ? save.request.path + " is used by " + users
                            : save.request.path + " is written, but no node is up that loads it";
  return out;
}

}  // namespace helix_arm::ros_bridge
