#include "soaked_arm.hpp"

#include <algorithm>
#include <chrono>
#include <thread>
#include <utility>

#include "helix_arm/regulator/config.hpp"

namespace helix_arm::test {
namespace {

using control::SafetyState;
using simulation::DeviceFault;

constexpr double kRate = 1000;  // of targets [Hz]
// Of a machine with other things to do: a turn, a thread or a reading that comes late [s].
constexpr double kSlack = 0.5;
constexpr double kFill = 3;  // time constants from no pressure to one beyond all limits
// Far enough off a set point, in follow_tolerance, and for long enough, in time constants beyond
// follow_time, that it is off what any lag makes of it.
constexpr double kAstray = 1.5;
constexpr double kSettled = 5;
constexpr double kStranded = 30;  // without getting it enabled again [s]

std::unique_ptr<regulator::RegulatorIo> startIo(const io::Scene& scene) {
  regulator::IoRules rules;
  rules.period = 0.005;
  const int channels = scene.arm.actuatorCount();
  return std::make_unique<regulator::RegulatorIo>(regulator::makeDriver(*scene.regulator, channels),
                                                  channels, rules);
}

bool isDevices(int trouble) { return trouble < simulation::kDeviceFaultCount; }

// Nothing can be told to a device, or nothing that it says be believed, while it lasts.
bool silences(int trouble) {
  switch (static_cast<DeviceFault>(trouble)) {
    case DeviceFault::kSilence:
    case DeviceFault::kGarbage:
    case DeviceFault::kHalfLine:
    case DeviceFault::kSlow:
    case DeviceFault::kNanText:
      return true;
    default:
      return false;
  }
}

// Whatever is wrong, orders come in and let the air out.
bool canVent(int trouble) {
  switch (static_cast<DeviceFault>(trouble)) {
    case DeviceFault::kBurst:
    case DeviceFault::kLowSupply:
    case DeviceFault::kWrongUnit:
    case DeviceFault::kStuckValue:
      return true;
    default:
      return !isDevices(trouble);
  }
}

// Its inlet does not close, whatever the order.
bool overfills(int trouble) { return trouble == static_cast<int>(DeviceFault::kStuckOpen); }

// All that it was told is lost, and every link, however short it was away.
bool restarts(int trouble) { return trouble == static_cast<int>(DeviceFault::kRestart); }

}  // namespace

const char* troubleName(int trouble) {
  constexpr const char* kOthers[] = {"silent commander", "emergency stop", "vent asked for"};
  return isDevices(trouble) ? simulation::nameOf(static_cast<DeviceFault>(trouble))
                            : kOthers[trouble - kSilentCommander];
}

SoakedArm::SoakedArm(const io::Scene& scene, SoakedDevice device, unsigned seed)
    : device_(std::move(device)),
      random_(seed),
      path_({scene.safety.channels, scene.safety.rules}, startIo(scene)),
      rules_(scene.safety.rules),
      goal_(Eigen::VectorXd::Zero(scene.arm.actuatorCount())),
      true_pressure_(goal_),
      astray_(scene.safety.channels.size()) {}

void SoakedArm::run(const std::atomic<bool>& stop) {
  now_ = regulator::steadyNow();
  trouble_ended_ = now_;
  enter(Phase::kRecover, kStranded);
  auto next = std::chrono::steady_clock::now();
  while (!stop && tally_.stranded == 0) {
    next += std::chrono::microseconds(static_cast<int>(1e6 / kRate));
    std::this_thread::sleep_until(next);
    turn();
  }
}

void SoakedArm::enter(Phase phase, double lasts) {
  phase_ = phase;
  phase_began_ = now_;
  phase_ends_ = now_ + lasts;
}

void SoakedArm::turn() {
  now_ = regulator::steadyNow();
  if (now_ >= next_goal_) {
    for (int i = 0; i < goal_.size(); ++i) {
      const model::Range& limits = path_.core().channels()[static_cast<std::size_t>(i)].limits;
      goal_[i] = random_.uniform(limits.lower, limits.upper);
    }
    next_goal_ = now_ + random_.uniform(0.2, 2);
  }
  const bool speaks = !(phase_ == Phase::kTrouble && trouble_ == kSilentCommander);
  if (speaks && path_.target(now_, goal_)) {
    ++tally_.targets;
    if (pending_target_ == 0 && phase_ == Phase::kFollow) pending_target_ = now_;
  } else {
    path_.turn(now_);
  }
  true_pressure_ = device_.pressure().head(goal_.size());
  for (int i = 0; i < goal_.size(); ++i) {
    const double limit = path_.core().channels()[static_cast<std::size_t>(i)].limits.upper;
    if (overfills(trouble_)) continue;
    tally_.highest = std::max(tally_.highest, true_pressure_[i] / limit);
    if (true_pressure_[i] > limit + rules_.trip_margin) tally_.burst = true;
  }
  watchCourse();
  if (phase_ == Phase::kFollow) follow();
  if (phase_ == Phase::kTrouble) endure();
  if (phase_ == Phase::kRecover) recover();
}

// Whichever rule sees it, and whatever the device says: where the air is not as commanded the arm
// does not stay enabled.
void SoakedArm::watchCourse() {
  const double time = rules_.follow_time + kSettled * rules_.time_constant + kSlack;
  for (int i = 0; i < true_pressure_.size(); ++i) {
    control::Persistence& astray = astray_[static_cast<std::size_t>(i)];
    const double off = std::abs(true_pressure_[i] - path_.core().orders().set_point[i]);
    astray.look(now_, enabled() && off > kAstray * rules_.follow_tolerance, time);
    if (!astray.lasts()) continue;
    miss("astray, " + path_.core().channels()[static_cast<std::size_t>(i)].name + " by " +
         std::to_string(1e-3 * off) + " kPa");
  }
}

bool SoakedArm::empty() const { return true_pressure_.maxCoeff() < rules_.vented_below; }

void SoakedArm::follow() {
  const double written = device_.last_write();
  if (pending_target_ > 0 && written > pending_target_) {
    tally_.writes.add(written - pending_target_);
    pending_target_ = 0;
  }
  if (!enabled()) {
    ++tally_.unprovoked;
    trouble_ = -1;
    missed_ = false;
    trouble_ended_ = now_;
    pending_target_ = 0;
    tally_.last_reason =
        "without trouble: " + path_.core().reason() + " (" + path_.io()->status().last_error + ")";
    enter(Phase::kRecover, kStranded);
  } else if (now_ >= phase_ends_) {
    begin(random_.integer(1, kTroubleCount - 1));
  }
}

void SoakedArm::begin(int trouble) {
  trouble_ = trouble;
  trouble_began_ = now_;
  decided_ = emptied_ = missed_ = false;
  pending_target_ = 0;
  ++tally_.troubles[static_cast<std::size_t>(trouble)].injected;
  if (isDevices(trouble)) device_.setFault(static_cast<DeviceFault>(trouble));
  if (trouble == kStopEngaged) path_.core().emergencyStop(now_, true);
  if (trouble == kVentAsked) path_.core().vent(now_);
  enter(Phase::kTrouble, random_.logUniform(0.05, 5));
}

// When at the latest the trouble ends kEnabled, if it lasts. The others have no such time: a stuck
// value may be one that the arm has, a target one that a weak supply reaches. See watchCourse().
double SoakedArm::mustDecide() const {
  if (trouble_ == kStopEngaged || trouble_ == kVentAsked) return trouble_began_;
  if (trouble_ == kSilentCommander) return trouble_began_ + rules_.target_timeout + kSlack;
  if (silences(trouble_) || restarts(trouble_)) {
    return trouble_began_ + rules_.reading_timeout + kSlack;
  }
  if (overfills(trouble_)) {
    return trouble_began_ + kFill * rules_.time_constant + rules_.spike_time + kSlack;
  }
  return std::numeric_limits<double>::infinity();
}

// Times of the trouble's tally, once each.
void SoakedArm::note() {
  if (trouble_ < 0) return;
  TroubleTally& tally = tally_.troubles[static_cast<std::size_t>(trouble_)];
  if (!decided_ && !enabled()) {
    decided_ = true;
    left_enabled_ = now_;
    tally.decided.add(now_ - trouble_began_);
  }
  if (decided_ && !emptied_ && empty()) {
    emptied_ = true;
    tally.empty.add(now_ - trouble_began_);
  }
}

void SoakedArm::miss(const std::string& what) {
  if (missed_) return;
  missed_ = true;
  ++tally_.missed;
  if (trouble_ >= 0) ++tally_.troubles[static_cast<std::size_t>(trouble_)].missed;
  tally_.last_reason = std::string(trouble_ < 0 ? "no trouble" : troubleName(trouble_)) + ": " +
                       what + "; " + path_.core().reason();
}

void SoakedArm::endure() {
  note();
  if (!decided_ && now_ > mustDecide()) miss("still enabled");
  // Whatever the device says of itself, it is to be empty in time.
  if (canVent(trouble_) && decided_ && !emptied_ &&
      now_ > left_enabled_ + rules_.vent_time + kSlack) {
    miss("pressure stands");
  }
  if (now_ < phase_ends_) return;
  if (isDevices(trouble_)) device_.setFault(DeviceFault::kNone);
  if (trouble_ == kStopEngaged) path_.core().emergencyStop(now_, false);
  trouble_ended_ = now_;
  enter(Phase::kRecover, kStranded);
}

void SoakedArm::recover() {
  note();
  if (phase_began_ == now_) return;  // what was said to the device has its first turn yet
  // Silent for the last of its time, the link is found dead only now.
  const bool settles = now_ < trouble_ended_ + rules_.reading_timeout + kSlack;
  if (enabled()) {
    if (settles) return;
    if (restarts(trouble_) && !decided_) {
      miss("still enabled");
    } else if (trouble_ >= 0 && !decided_) {
      ++tally_.troubles[static_cast<std::size_t>(trouble_)].endured;
    }
    enter(Phase::kFollow, random_.uniform(0.5, 3));
    return;
  }
  const regulator::IoRules io;
  const double reachable = trouble_ >= 0 && isDevices(trouble_) ? io.longest_back_off + 1 : 0;
  const double left = std::max(trouble_ended_, decided_ ? left_enabled_ : trouble_ended_);
  if (!empty() && now_ > left + reachable + rules_.vent_time + kSlack) miss("pressure stands");
  if (trouble_ >= 0 && decided_ && !emptied_) return;
  if (path_.core().enable(now_).empty()) {
    trouble_ = -1;
    enter(Phase::kFollow, random_.uniform(0.5, 3));
  } else if (now_ >= phase_ends_) {
    ++tally_.stranded;
    miss("cannot be enabled: " + path_.core().refusal(now_) + " (" +
         path_.io()->status().last_error + ")");
  }
}

}  // namespace helix_arm::test
