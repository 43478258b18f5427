// The pressure path, from targets to the devices' valves, for minutes on end with trouble at
// random: a thousand targets a second for each of two arms, one on a serial line and one on Modbus
// TCP. Exits with 1 where a vent was missed, a pressure stayed off its set point in an enabled arm,
// an arm could not be enabled again, a pressure went beyond its limit and the margin, or memory
// grew.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <set>

#include <CLI/CLI.hpp>

#include "helix_arm/io/scene.hpp"
#include "regulator/guard_process.hpp"
#include "simulation/emulated_device.hpp"
#include "support/random.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

using simulation::DeviceFault;

using SharedDevice = std::shared_ptr<simulation::EmulatedDevice>;

// What is done to the arm: the faults of its device, by their number, and three more.
constexpr int kSilentCommander = simulation::kDeviceFaultCount;
constexpr int kStopEngaged = kSilentCommander + 1;
constexpr int kVentAsked = kStopEngaged + 1;
constexpr int kTroubleCount = kVentAsked + 1;

struct SoakTally {
  int injected = 0;    //< troubles
  int missed = 0;      //< that did not end as they had to, and without a trouble
  int stranded = 0;    //< troubles after which it could not be enabled again
  bool burst = false;  //< a pressure went beyond its limit by more than the margin of the rules
  std::string last_reason;  //< of the last miss
};

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

using Faults = std::set<DeviceFault>;
bool isOf(const Faults& faults, int trouble) {
  return faults.count(static_cast<DeviceFault>(trouble)) > 0;
}
// Nothing can be told to a device, or nothing that it says be believed, while it lasts.
const Faults kSilences = {DeviceFault::kSilence, DeviceFault::kGarbage, DeviceFault::kHalfLine,
                          DeviceFault::kSlow, DeviceFault::kNanText};
// Whatever is wrong, orders come in and let the air out.
const Faults kVentable = {DeviceFault::kBurst, DeviceFault::kLowSupply, DeviceFault::kWrongUnit,
                          DeviceFault::kStuckValue};
bool canVent(int trouble) { return !isDevices(trouble) || isOf(kVentable, trouble); }

// Its inlet does not close, whatever the order.
bool overfills(int trouble) { return trouble == static_cast<int>(DeviceFault::kStuckOpen); }

// All that it was told is lost, and every link, however short it was away.
bool restarts(int trouble) { return trouble == static_cast<int>(DeviceFault::kRestart); }

const char* troubleName(int trouble) {
  constexpr const char* kOthers[] = {"silent commander", "emergency stop", "vent asked for"};
  return isDevices(trouble) ? simulation::nameOf(static_cast<DeviceFault>(trouble))
                            : kOthers[trouble - kSilentCommander];
}

// Commands one arm at 1 kHz, makes trouble at random, and looks at the device's true pressures.
class SoakedArm {
 public:
  // @param scene  whose regulator is the device.
  SoakedArm(const io::Scene& scene, SharedDevice device, unsigned seed)
      : device_(std::move(device)),
        random_(seed),
        path_({scene.safety.channels, scene.safety.rules}, startIo(scene)),
        rules_(scene.safety.rules),
        goal_(Eigen::VectorXd::Zero(scene.arm.actuatorCount())),
        true_pressure_(goal_),
        astray_(scene.safety.channels.size()) {}

  void run(const std::atomic<bool>& stop) {
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

  const SoakTally& tally() const { return tally_; }

 private:
  enum class Phase { kFollow, kTrouble, kRecover };

  void turn() {
    now_ = regulator::steadyNow();
    if (now_ >= next_goal_) {
      for (int i = 0; i < goal_.size(); ++i) {
        const model::Range& limits = path_.core().channels()[static_cast<std::size_t>(i)].limits;
        goal_[i] = random_.uniform(limits.lower, limits.upper);
      }
      next_goal_ = now_ + random_.uniform(0.2, 2);
    }
    const bool speaks = !(phase_ == Phase::kTrouble && trouble_ == kSilentCommander);
    if (!speaks || !path_.target(now_, goal_)) path_.turn(now_);
    true_pressure_ = device_->pressure().head(goal_.size());
    for (int i = 0; i < goal_.size(); ++i) {
      const double limit = path_.core().channels()[static_cast<std::size_t>(i)].limits.upper;
      if (overfills(trouble_)) continue;
      if (true_pressure_[i] > limit + rules_.trip_margin) tally_.burst = true;
    }
    watchCourse();
    if (phase_ == Phase::kFollow) follow();
    if (phase_ == Phase::kTrouble) endure();
    if (phase_ == Phase::kRecover) recover();
  }

  void follow() {
    if (!enabled()) {
      trouble_ = -1;
      missed_ = false;
      trouble_ended_ = now_;
      tally_.last_reason = "without trouble: " + path_.core().reason() + " (" +
                           path_.io()->status().last_error + ")";
      enter(Phase::kRecover, kStranded);
    } else if (now_ >= phase_ends_) {
      begin(random_.integer(1, kTroubleCount - 1));
    }
  }

  void begin(int trouble) {
    trouble_ = trouble;
    trouble_began_ = now_;
    decided_ = emptied_ = missed_ = false;
    ++tally_.injected;
    if (isDevices(trouble)) device_->setFault(static_cast<DeviceFault>(trouble));
    if (trouble == kStopEngaged) path_.core().emergencyStop(now_, true);
    if (trouble == kVentAsked) path_.core().vent(now_);
    enter(Phase::kTrouble, random_.logUniform(0.05, 5));
  }

  void endure() {
    note();
    if (!decided_ && now_ > mustDecide()) miss("still enabled");
    // Whatever the device says of itself, it is to be empty in time.
    if (canVent(trouble_) && decided_ && !emptied_ &&
        now_ > left_enabled_ + rules_.vent_time + kSlack) {
      miss("pressure stands");
    }
    if (now_ < phase_ends_) return;
    if (isDevices(trouble_)) device_->setFault(DeviceFault::kNone);
    if (trouble_ == kStopEngaged) path_.core().emergencyStop(now_, false);
    trouble_ended_ = now_;
    enter(Phase::kRecover, kStranded);
  }

  void recover() {
    note();
    if (phase_began_ == now_) return;  // what was said to the device has its first turn yet
    // Silent for the last of its time, the link is found dead only now.
    const bool settles = now_ < trouble_ended_ + rules_.reading_timeout + kSlack;
    if (enabled()) {
      if (settles) return;
      if (restarts(trouble_) && !decided_) miss("still enabled");
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

  void enter(Phase phase, double lasts) {
    phase_ = phase;
    phase_began_ = now_;
    phase_ends_ = now_ + lasts;
  }

  bool enabled() const { return path_.core().state() == control::SafetyState::kEnabled; }
  bool empty() const { return true_pressure_.maxCoeff() < rules_.vented_below; }

  // When at the latest the trouble ends kEnabled, if it lasts. The others have no such time: a
  // stuck value may be one that the arm has, a target one that a weak supply reaches. See
  // watchCourse().
  double mustDecide() const {
    if (trouble_ == kStopEngaged || trouble_ == kVentAsked) return trouble_began_;
    if (trouble_ == kSilentCommander) return trouble_began_ + rules_.target_timeout + kSlack;
    if (isOf(kSilences, trouble_) || restarts(trouble_)) {
      return trouble_began_ + rules_.reading_timeout + kSlack;
    }
    if (overfills(trouble_)) {
      return trouble_began_ + kFill * rules_.time_constant + rules_.spike_time + kSlack;
    }
    return std::numeric_limits<double>::infinity();
  }

  // What the trouble has led to.
  void note() {
    if (trouble_ < 0) return;
    if (!decided_ && !enabled()) {
      decided_ = true;
      left_enabled_ = now_;
    }
    emptied_ = emptied_ || (decided_ && empty());
  }

  // Whichever rule sees it, and whatever the device says: where the air is not as commanded the arm
  // does not stay enabled.
  void watchCourse() {
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

  void miss(const std::string& what) {
    if (missed_) return;
    missed_ = true;
    ++tally_.missed;
    tally_.last_reason = std::string(trouble_ < 0 ? "no trouble" : troubleName(trouble_)) + ": " +
                         what + "; " + path_.core().reason();
  }

  SharedDevice device_;
  Random random_;
  regulator::PressurePath path_;
  const control::SafetyRules rules_;
  SoakTally tally_;

  double now_ = 0;
  Eigen::VectorXd goal_;
  Eigen::VectorXd true_pressure_;
  std::vector<control::Persistence> astray_;  // (channels) while enabled
  double next_goal_ = 0;

  Phase phase_ = Phase::kRecover;
  double phase_began_ = 0, phase_ends_ = 0;
  int trouble_ = -1;
  double trouble_began_ = 0, trouble_ended_ = 0;
  bool decided_ = false, emptied_ = false, missed_ = false;
  double left_enabled_ = 0;
};

constexpr double kMostGrowth = 0.1;
constexpr double kWarmUp = 30;  // until every buffer has had its use [s]

io::Scene sceneWith(const std::string& regulator) {
  return io::loadScene(HELIX_ARM_SOURCE_DIR "/config/scenes/spatial_50.yaml",
                       {{"regulator", regulator},
                        {"safety.target_timeout_s", "0.5"},
                        {"safety.reading_timeout_s", "0.5"}});
}

regulator::SimulatedRegulatorConfig valves(unsigned seed) {
  regulator::SimulatedRegulatorConfig config;
  config.time_constant = 0.1;
  config.noise = 1e3;
  config.seed = seed;
  return config;
}

SoakedArm serialArm(const TemporaryFolder& folder, unsigned seed) {
  const io::Scene scene = sceneWith("{ascii_serial: {profile: alicat, device: " + folder.path() +
                                    "/line, addresses: [A, B, C]}}");
  simulation::EmulatedDeviceConfig config;
  config.regulator = *scene.regulator;
  config.channels = scene.arm.actuatorCount();
  config.valves = valves(seed);
  config.seed = seed;
  return {scene, std::make_shared<simulation::EmulatedDevice>(config), seed};
}

SoakedArm modbusArm(unsigned seed) {
  const auto sceneAt = [](int port) {
    return sceneWith("{modbus_tcp: {profile: festo_vtem, host: 127.0.0.1, port: " +
                     std::to_string(port) + ", slots: [0, 1, 2]}}");
  };
  simulation::EmulatedDeviceConfig config;
  config.regulator = *sceneAt(502).regulator;
  std::get<regulator::ModbusConfig>(config.regulator).port = 0;
  config.channels = 4;
  config.valves = valves(seed);
  const auto device = std::make_shared<simulation::EmulatedDevice>(config);
  return {sceneAt(device->port()), device, seed + 1};
}

double residentMegabytes() {
  std::ifstream file("/proc/self/statm");
  double total = 0, resident = 0;
  file >> total >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1 << 20);
}

int soak(double minutes, unsigned seed) {
  const TemporaryFolder folder;
  SoakedArm arms[] = {serialArm(folder, seed), modbusArm(seed)};
  const char* names[] = {"ascii_serial alicat", "modbus_tcp festo_vtem"};
  std::atomic<bool> stop{false};
  std::vector<std::thread> threads;
  for (SoakedArm& arm : arms) threads.emplace_back([&arm, &stop] { arm.run(stop); });

  const double seconds = 60 * minutes;
  const double warm_up = std::min(kWarmUp, seconds / 2);
  std::this_thread::sleep_for(std::chrono::duration<double>(warm_up));
  const double start = residentMegabytes();
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds - warm_up));
  const double end = residentMegabytes();
  stop = true;
  for (std::thread& thread : threads) thread.join();

  int injected = 0, missed = 0, stranded = 0, burst = 0;
  for (int i = 0; i < 2; ++i) {
    const SoakTally& tally = arms[i].tally();
    std::printf("%s: %s\n", names[i], tally.last_reason.c_str());
    injected += tally.injected;
    missed += tally.missed;
    stranded += tally.stranded;
    burst += tally.burst ? 1 : 0;
  }
  const double growth = end / start - 1;
  std::printf(
      "\n%d troubles in %g minutes (seed %u), %d missed vents, %d arms stranded, %d beyond "
      "their limits\n",
      injected, minutes, seed, missed, stranded, burst);
  std::printf("memory: %.1f MB after %.0f s, %.1f MB at the end: ratio %.3f\n", start, warm_up, end,
              1 + growth);
  return missed > 0 || stranded > 0 || burst > 0 || injected == 0 || growth > kMostGrowth ? 1 : 0;
}

}  // namespace
}  // namespace helix_arm::test

int main(int argc, char** argv) {
  double minutes = 10;
  unsigned seed = 1;
  CLI::App app{"The pressure path of two arms with trouble at random"};
  app.add_option("--minutes", minutes)->check(CLI::Range(1e-3, 1e5));
  app.add_option("--seed", seed)->check(CLI::Range(0, 1000000000));
  CLI11_PARSE(app, argc, argv);
  return helix_arm::test::soak(minutes, seed);
}
