#include "guard_process.hpp"

#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <stdexcept>

#include <poll.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "helix_arm/basics/requirement.hpp"
#include "realtime.hpp"

namespace helix_arm::regulator {
namespace {

constexpr int kBetweenPolls = 5;  // [ms]

[[noreturn]] void fail(const std::string& what, int error) {
  throw std::runtime_error(
      "the guard, which vents the arm if this process is killed, cannot be started: " + what +
      ": " + std::strerror(error));
}

constexpr double kJustThen = 2;  // between an error and the fault that it caused [s]

}  // namespace

GuardProcess::GuardProcess(const std::vector<std::string>& command, int realtime_priority) {
  basics::require(!command.empty(), "a guard without a command; expected a program");
  int ends[2];
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) fail("socketpair", errno);
  std::vector<char*> arguments;
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);

  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, ends[0], STDIN_FILENO);
#if __GLIBC_PREREQ(2, 34)
  // Other connections of this process must close when it ends, so the guard does not inherit them.
  posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
#endif
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSID);
  const int error =
      posix_spawn(&pid_, arguments[0], &actions, &attributes, arguments.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  ::close(ends[0]);
  line_ = ends[1];
  if (error != 0) {
    ::close(line_);
    fail(command[0], error);
  }
  beat();  // silence counts from now on
  beats_ = std::thread([this, realtime_priority] { keepBeating(realtime_priority); });
}

GuardProcess::~GuardProcess() {
  {
    const basics::MutexLock lock(mutex_);
    ended_ = true;
  }
  ends_.notifyOne();
  beats_.join();
  ::close(line_);
}

void GuardProcess::beat() const {
  // Fails if the guard has ended or does not read; state() reports it.
  send(line_, &kBeat, 1, MSG_NOSIGNAL | MSG_DONTWAIT);
}

void GuardProcess::keepBeating(int realtime_priority) {
  scheduleRealtime(realtime_priority);
  const std::chrono::duration<double> period(kBeatPeriod);
  basics::MutexLock lock(mutex_);
  while (!ends_.waitFor(lock, period, [this]() HELIX_ARM_REQUIRES(mutex_) { return ended_; })) {
    // Counts periods rather than time: a machine that was suspended has lost only one.
    if (takeAnswers()) {
      patience_ = kMissedBeats;
      answered_ = true;
    } else if (patience_ > 0) {
      --patience_;
    }
    // More beats would fill the buffer of a stopped guard and leave no room for its dismissal.
    if (patience_ > 0) beat();
  }
}

bool GuardProcess::takeAnswers() const {
  bool any = false;
  char bytes[64];
  while (recv(line_, bytes, sizeof bytes, MSG_DONTWAIT) > 0) any = true;
  return any;
}

void GuardProcess::dismiss() {
  dismissed_ = true;
  if (hasEnded()) return;
  // Fails only if the guard has just ended.
  send(line_, &kDismissal, 1, MSG_NOSIGNAL | MSG_DONTWAIT);
  shutdown(line_, SHUT_WR);
  const double deadline = steadyNow() + kDismissTime;
  while (!hasEnded() && steadyNow() < deadline) poll(nullptr, 0, kBetweenPolls);
  pid_ = -1;
}

control::Guard GuardProcess::state() const {
  using control::Guard;
  if (dismissed_ || hangsUp()) return Guard::kEnded;
  if (patience_ <= 0) return Guard::kStandsStill;
  return answered_ ? Guard::kStands : Guard::kStarting;
}

// The guard's end of the socket closes however the guard ends.
bool GuardProcess::hangsUp() const {
  pollfd end{line_, 0, 0};
  return poll(&end, 1, 0) > 0 && (end.revents & POLLHUP) != 0;
}

bool GuardProcess::hasEnded() {
  if (pid_ > 0 && waitpid(pid_, nullptr, WNOHANG) == pid_) pid_ = -1;
  return pid_ < 0;
}

IoRules ioRulesOf(const control::SafetyRules& rules) {
  IoRules out;
  out.vented_below = rules.vented_below;
  out.vent_time = rules.vent_time;
  return out;
}

PressurePath::PressurePath(control::SafetyCore core, std::unique_ptr<RegulatorIo> io,
                           double longest_gap)
    : core_(std::move(core)),
      reading_(static_cast<int>(core_.channels().size())),
      longest_gap_(longest_gap),
      io_(std::move(io)) {
  basics::requireValue(longest_gap > 0, "pressure path", "the longest gap [s]", longest_gap,
                       "a value > 0");
}

void PressurePath::askGuard(double now) {
  core_.guarded(now, guard_ ? guard_->state() : control::Guard::kNotNeeded);
}

const control::ValveOrders& PressurePath::turn(double now) {
  fresh_ = false;
  askGuard(now);
  if (now - last_turn_ > longest_gap_) {
    core_.linked(now, false);
    core_.linked(now, true);
  }
  last_turn_ = now;
  if (io_) {
    // A link that dropped and came back between two turns counts as dropped.
    const std::uint64_t breaks = io_->breaks();
    if (breaks != breaks_seen_) core_.linked(now, false);
    breaks_seen_ = breaks;
    core_.linked(now, io_->up());
    fresh_ = io_->take(reading_);
    // A reading that was delayed, or that waited for a late turn, does not describe the present.
    const double age = now - reading_.time;
    if (fresh_ && age <= core_.rules().reading_timeout) {
      core_.measured(now, reading_.pressures.pressure, reading_.pressures.supply, age);
    }
  }
  const control::ValveOrders& orders = core_.advance(now);
  if (io_) io_->order(orders, breaks_seen_);
  return orders;
}

bool PressurePath::target(double now, const Eigen::Ref<const Eigen::VectorXd>& pressure) {
  fresh_ = false;
  const bool taken = core_.target(now, pressure);
  if (taken) turn(now);
  return taken;
}

control::SafetyText PressurePath::text() const {
  control::SafetyText out = core_.text();
  if (!io_) return out;
  const IoStatus line = io_->status();
  const control::SafetyReport& report = core_.report();
  const bool of_line = report.cause == control::SafetyCause::kRegulatorLost ||
                       report.cause == control::SafetyCause::kStaleReading;
  const bool just_then = std::abs(line.last_error_time - report.since) < kJustThen;
  if (!line.last_error.empty() && (!line.up || (of_line && just_then))) {
    std::string& last = !out.remedy.empty()   ? out.remedy
                        : !out.action.empty() ? out.action
                                              : out.problem;
    last += " (" + line.last_error + ")";
  }
  return out;
}

std::string PressurePath::enable(double now) {
  askGuard(now);
  std::string refusal = core_.enable(now);
  if (refusal.empty() || !io_) return refusal;
  const IoStatus line = io_->status();
  if (line.last_error_time > line.last_read_time) refusal += " (" + line.last_error + ")";
  return refusal;
}

}  // namespace helix_arm::regulator
