#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <limits>
#include <thread>

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "basics/text.hpp"
#include "command.hpp"
#include "helix_arm/clearance/sweep.hpp"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/regulator/config.hpp"
#include "helix_arm/regulator/driver.hpp"
#include "regulator/guard_process.hpp"
#include "regulator/realtime.hpp"
#include "regulator/regulator_io.hpp"
#include "simulation/emulated_device.hpp"

namespace helix_arm::cli {
namespace {

using control::SafetyCause;
using control::SafetyState;
using control::Valve;
using regulator::steadyNow;

constexpr double kProbeSeconds = 1;
constexpr double kStay = 5;            // [s]
constexpr double kLongestRun = 86400;  // [s]
constexpr double kBetweenReports = 1;  // of an emulated device [s]
constexpr double kBetweenLines = 0.5;  // [s]
constexpr double kLinkTime = 5;        // for a regulator to answer [s]
constexpr double kTrying = 10;         // to vent [s]
constexpr double kSupplyAbove = 1.25;  // relative to the largest pressure limit
constexpr double kNoise = 500;         // [Pa]
constexpr double kNever = std::numeric_limits<double>::infinity();
constexpr double kNoReading = std::numeric_limits<double>::quiet_NaN();
constexpr std::chrono::milliseconds kTurn(5);
constexpr std::chrono::milliseconds kBetweenReadings(10);
constexpr std::chrono::milliseconds kBetweenVents(50);

struct RegulatorOptions {
  std::string scene;
  InputArguments pressure;        // set
  std::optional<double> seconds;  // probe, set, emulate
  bool yes = false;               // set: air may move
  int realtime_priority = 0;      // guard: as regulator::scheduleRealtime() where it is allowed
};

// @throws CallerError where the scene has no regulator; as loadScene().
io::Scene loadRegulatedScene(const RegulatorOptions& options, const GlobalOptions& global) {
  io::Scene scene = loadScene(options.scene, global);
  refuseIf(!scene.regulator, "scene ", scene.name,
           " has no regulator; add the section `regulator` to it");
  return scene;
}

std::unique_ptr<regulator::Driver> makeDriver(const io::Scene& scene) {
  return regulator::makeDriver(*scene.regulator, scene.arm.actuatorCount());
}

// Answers of a regulator.
struct Answers {
  explicit Answers(int channels)
      : pressure(Eigen::VectorXd::Constant(channels, kNoReading)), readings(channels, 0) {}

  Eigen::VectorXd pressure;   // (channels) last readings, gauge, NaN without [Pa]
  std::vector<int> readings;  // (channels)
  double supply = kNoReading;
  double seconds = 0;
  std::string reason;  // why it is not vented, or a channel not read; empty on success
};

void readOnce(regulator::Driver& driver, Answers& answers) {
  regulator::Pressures pressures(static_cast<int>(answers.pressure.size()));
  driver.read(pressures);
  for (Eigen::Index i = 0; i < answers.pressure.size(); ++i) {
    if (!std::isfinite(pressures.pressure[i])) continue;
    answers.pressure[i] = pressures.pressure[i];
    ++answers.readings[static_cast<std::size_t>(i)];
  }
  if (std::isfinite(pressures.supply)) answers.supply = pressures.supply;
}

// Vents through a driver that is connected, and goes on to, until no channel has pressure; for as
// long as the scene's safety.vent_time_s at most. @throws regulator::LinkError.
Answers ventAll(regulator::Driver& driver, const io::Scene& scene) {
  const int channels = scene.arm.actuatorCount();
  const control::SafetyRules& rules = scene.safety.rules;
  Answers result(channels);
  const double end = steadyNow() + rules.vent_time;
  for (;;) {
    std::string bad_reply;
    try {
      driver.vent();
      readOnce(driver, result);
    } catch (const regulator::BadReply& error) {
      bad_reply = error.what();
    }
    int full = 0;
    while (full < channels && std::abs(result.pressure[full]) <= rules.vented_below) ++full;
    if (full == channels) return result;
    if (steadyNow() >= end) {
      result.reason =
          scene.arm.actuator(full).name +
          (std::isnan(result.pressure[full])
               ? " gives no reading" + (bad_reply.empty() ? "" : ": " + bad_reply)
               : basics::format(" still has %g kPa after %g s; shut the supply and check for a "
                                "valve that does not close",
                                result.pressure[full] / 1e3, rules.vent_time));
      return result;
    }
    std::this_thread::sleep_for(kBetweenReadings);
  }
}

// Connects, and vents as ventAll() does; with the reason if there is no link.
Answers connectAndVent(regulator::Driver& driver, const io::Scene& scene) {
  Answers result(scene.arm.actuatorCount());
  try {
    driver.connect();
    result = ventAll(driver, scene);
  } catch (const regulator::LinkError& error) {
    result.reason = error.what();
  }
  return result;
}

Answers probe(const io::Scene& scene, double seconds) {
  const InterruptWatch watch;
  Answers result(scene.arm.actuatorCount());
  std::string bad_reply;
  try {
    const auto driver = makeDriver(scene);
    driver->connect();
    const double begin = steadyNow();
    while (!interrupted() && steadyNow() - begin < seconds) {
      try {
        readOnce(*driver, result);
      } catch (const regulator::BadReply& error) {
        bad_reply = error.what();
        std::this_thread::sleep_for(kBetweenReadings);
      }
    }
    result.seconds = steadyNow() - begin;
  } catch (const regulator::LinkError& error) {
    result.reason = error.what();
    return result;
  }
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    if (result.readings[static_cast<std::size_t>(i)] > 0 || !result.reason.empty()) continue;
    result.reason = scene.arm.actuator(i).name + " gives no reading" +
                    (bad_reply.empty() ? "; check its sensor and address" : ": " + bad_reply);
  }
  return result;
}

// Tells the reason, and gives the exit code.
int endOf(const std::string& reason) {
  if (reason.empty()) return kDone;
  std::cerr << reason << "\n";
  return kNotPossible;
}

int probeRegulator(const RegulatorOptions& options, const GlobalOptions& global) {
  const io::Scene scene = loadRegulatedScene(options, global);
  const Answers result = probe(scene, options.seconds.value_or(kProbeSeconds));
  const double seconds = result.seconds;
  json channels = json::array(), rates = json::array();
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    const int readings = result.readings[static_cast<std::size_t>(i)];
    channels.push_back({{"name", scene.arm.actuator(i).name},
                        {"address", regulator::addressOf(*scene.regulator, i)},
                        {"pressure_pa", result.pressure[i]},
                        {"readings", readings}});
    rates.push_back(channels.back());
    // Without a line to a device, their rate is that of this computer.
    const bool timed = seconds > 0 && regulator::isHardware(*scene.regulator);
    rates.back()["readings_per_second"] = valueIf(timed, readings / seconds);
    rates.back()["supply_pa"] = result.supply;
  }
  const json report{{"regulator", regulator::describe(*scene.regulator)},
                    {"channels", channels},
                    {"supply_pa", result.supply},
                    {"seconds", seconds},
                    {"reason", textOrNull(result.reason)}};
  json shown = without(report, {"reason"});
  shown["channels"] = without(rates, {"supply_pa"});
  if (!std::isfinite(result.supply)) shown["supply"] = "not measured";
  shown["notes"] = {"connected, which vents; nothing else was written"};
  printResult(global.format, report, seconds > 0 ? shown : json(), [&rates](std::ostream& out) {
    printCsv({{"rows", rates}},
             {{"name", "address", "pressure_pa", "readings", "supply_pa"}, "rows"}, out);
  });
  return endOf(result.reason);
}

int ventRegulator(const RegulatorOptions& options, const GlobalOptions& global) {
  const io::Scene scene = loadRegulatedScene(options, global);
  const Answers result = connectAndVent(*makeDriver(scene), scene);
  const bool vented = result.reason.empty();
  json report{
      {"vented", vented}, {"pressure_pa", result.pressure}, {"reason", textOrNull(result.reason)}};
  json shown = report;
  shown["actuators"] = scene.arm.actuatorNames();  // tells whose the pressures are
  shown["vented_below_kpa"] = scene.safety.rules.vented_below / 1e3;
  printResult(global.format, report, vented ? shown : json(), Csv{{"vented", "pressure_pa"}});
  return endOf(vented ? "" : "not vented: " + result.reason);
}

struct Outcome {
  Eigen::VectorXd pressure;  // before it vented [Pa]
  SafetyState state = SafetyState::kDisabled;
  std::string reason;  // cause of failure; empty on success
};

class Session {
 public:
  // guard: null if none is needed.
  Session(const io::Scene& scene, std::shared_ptr<const regulator::GuardProcess> guard, bool talks)
      : scene_(scene),
        guard_(std::move(guard)),
        talks_(talks),
        path_(control::SafetyCore(scene.safety.channels, scene.safety.rules),
              std::make_unique<regulator::RegulatorIo>(makeDriver(scene), scene.arm.actuatorCount(),
                                                       regulator::ioRulesOf(scene.safety.rules))) {
    path_.guardedBy(guard_);
  }

  Outcome run(const Eigen::VectorXd& target, double seconds) {
    Outcome outcome;
    outcome.reason = enable();
    if (outcome.reason.empty()) outcome.reason = stay(target, seconds);
    outcome.pressure = path_.core().reading();
    const std::string pressure_left = vent();
    if (outcome.reason.empty()) outcome.reason = pressure_left;
    outcome.state = path_.core().state();
    return outcome;
  }

 private:
  // Runs turns until the condition holds; false on a timeout.
  template <class Condition>
  bool turnUntil(double deadline, const Condition& condition) {
    for (;;) {
      path_.turn(steadyNow());
      tell();
      if (condition()) return true;
      if (steadyNow() >= deadline) return false;
      std::this_thread::sleep_for(kTurn);
    }
  }

  // @return the reason for refusal; empty on success.
  std::string enable() {
    // Pressure that is left from before the connection is vented first.
    const double deadline = steadyNow() + kLinkTime + scene_.safety.rules.vent_time;
    turnUntil(deadline, [this] {
      const bool unguarded = guard_ && control::isGone(guard_->state());
      return interrupted() || unguarded || path_.core().refusal(steadyNow()).empty();
    });
    if (interrupted()) return "interrupted";
    return path_.enable(steadyNow());
  }

  // The time starts when the set points are reached.
  std::string stay(const Eigen::VectorXd& target, double seconds) {
    control::SafetyCore& core = path_.core();
    double end = kNever;
    turnUntil(kNever, [&] {
      if (interrupted() || !core.target(steadyNow(), target)) return true;
      if (end == kNever && core.orders().set_point == core.goal()) end = steadyNow() + seconds;
      return steadyNow() >= end;
    });
    if (core.state() != SafetyState::kEnabled) return path_.reason();
    return interrupted() ? "interrupted" : "";
  }

  std::string vent() {
    path_.core().vent(steadyNow());
    const control::SafetyRules& rules = scene_.safety.rules;
    const bool vented =
        turnUntil(steadyNow() + rules.vent_time + rules.hold_time + kLinkTime, [this] {
          return path_.core().state() != SafetyState::kFault || path_.core().report().vent_overdue;
        });
    const bool overdue = path_.core().report().vent_overdue;
    return vented && !overdue ? "" : path_.reason();
  }

  void tell() {
    if (!talks_ || steadyNow() - told_ < kBetweenLines) return;
    told_ = steadyNow();
    const control::SafetyReport& report = path_.core().report();
    const bool vents =
        report.state == SafetyState::kFault && report.cause == SafetyCause::kVentRequested;
    std::cout << (vents ? "vents" : control::nameOf(report.state)) << ": "
              << pressureText(scene_.arm, path_.core().reading()) << std::endl;
  }

  const io::Scene& scene_;
  const std::shared_ptr<const regulator::GuardProcess> guard_;
  const bool talks_;
  regulator::PressurePath path_;
  double told_ = 0;
};

std::vector<std::string> guardCommand(const RegulatorOptions& options,
                                      const GlobalOptions& global) {
  std::vector<std::string> out = {std::filesystem::read_symlink("/proc/self/exe").string(),
                                  "regulator", options.scene, "guard"};
  for (const std::string& change : global.overrides) {
    out.insert(out.end(), {"--set", change});
  }
  return out;
}

// Refuses pressures on whose way from the atmosphere the arm comes too close to a zone.
void refuseBlocked(const io::Scene& scene, const Eigen::VectorXd& target) {
  if (!scene.keep_out) return;
  const Eigen::VectorXd vented = Eigen::VectorXd::Zero(target.size());
  const auto blocked = clearance::SweepCheck(scene.model, *scene.keep_out)
                           .sweep(clearance::pressuresOnTheWay(
                               scene.safety.channels, scene.safety.rules, vented, vented, target));
  refuseIf(blocked.has_value(), "the arm ", blocked ? blocked->text() : "",
           "; give other pressures, or plan a way around: helix_arm plan");
}

int setRegulator(const RegulatorOptions& options, const GlobalOptions& global) {
  const io::Scene scene = loadRegulatedScene(options, global);
  const Eigen::VectorXd target = inputsOf(scene, options.pressure);
  refuseIf(regulator::isHardware(*scene.regulator) && !options.yes, "set moves the hardware ",
           regulator::describe(*scene.regulator),
           "; add --yes once nobody is within the arm's reach");
  refuseBlocked(scene, target);
  const InterruptWatch watch;
  std::signal(SIGPIPE, SIG_IGN);  // a reader that has ended must not keep this process from venting
  std::shared_ptr<regulator::GuardProcess> guard;
  if (regulator::isHardware(*scene.regulator)) {
    guard = std::make_shared<regulator::GuardProcess>(guardCommand(options, global));
  }
  const Outcome outcome = Session(scene, guard, global.format == Format::kText)
                              .run(target, options.seconds.value_or(kStay));
  const bool never_enabled = outcome.state == SafetyState::kDisabled;
  if (guard && (never_enabled || outcome.state == SafetyState::kVented)) guard->dismiss();
  const char* const state = control::nameOf(outcome.state);
  const json report{{"target_pa", target},
                    {"pressure_pa", outcome.pressure},
                    {"state", state},
                    {"reason", textOrNull(outcome.reason)}};
  json shown = without(report, {"reason"});
  shown["actuators"] = scene.arm.actuatorNames();
  printResult(global.format, report, shown, [&](std::ostream& out) {
    CsvTable table(out, {"name", "target_pa", "pressure_pa", "state"});
    for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
      table.add({{"name", scene.arm.actuator(i).name},
                 {"target_pa", target[i]},
                 {"pressure_pa", outcome.pressure[i]},
                 {"state", state}});
    }
  });
  return endOf(outcome.reason);
}

// How the process that moves the arm (the ward) ended.
enum class End { kDismissesGuard, kIsGone, kStandsStill };

// Reads and answers stdin until then. Counts whole periods without a beat rather than time, so that
// a machine that was suspended has lost only one period.
End awaitEnd() {
  using regulator::GuardProcess;
  constexpr int kBeatMs = static_cast<int>(1e3 * GuardProcess::kBeatPeriod);
  bool beats = false;
  int missed = 0;
  for (;;) {
    pollfd waited{STDIN_FILENO, POLLIN, 0};
    const int ready = poll(&waited, 1, beats ? kBeatMs : -1);
    if (ready == 0 && ++missed == GuardProcess::kMissedBeats) return End::kStandsStill;
    if (ready <= 0) continue;
    char bytes[64];
    const ssize_t size = read(STDIN_FILENO, bytes, sizeof bytes);
    if (size < 0 && errno == EINTR) continue;
    if (size <= 0) return End::kIsGone;
    // The answer is only for a ward behind a socket that reads it.
    send(STDIN_FILENO, bytes, static_cast<std::size_t>(size), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (std::memchr(bytes, GuardProcess::kDismissal, static_cast<std::size_t>(size)) != nullptr) {
      return End::kDismissesGuard;
    }
    beats = true;
    missed = 0;
  }
}

// The ward must neither keep the line nor wake up and move the arm.
void endWard() {
  ucred ward{};
  socklen_t size = sizeof ward;
  if (getsockopt(STDIN_FILENO, SOL_SOCKET, SO_PEERCRED, &ward, &size) == 0) kill(ward.pid, SIGKILL);
}

int guardRegulator(const RegulatorOptions& options, const GlobalOptions& global) {
  for (const int number : {SIGINT, SIGTERM, SIGHUP, SIGPIPE}) std::signal(number, SIG_IGN);
  const io::Scene scene = loadRegulatedScene(options, global);
  const auto driver = makeDriver(scene);  // early, so that a fault shows before it is needed
  driver->ignoreOthers();  // the ward may still be exiting and hold the lock of the device
  // After the slow preparations. A refusal is not printed here: the node that started the guard
  // prints its own.
  regulator::scheduleRealtime(options.realtime_priority);
  if (options.realtime_priority > 0) regulator::lockMemory();
  const End end = awaitEnd();
  if (end == End::kDismissesGuard) return kDone;
  if (end == End::kStandsStill) endWard();
  const double begin = steadyNow();
  Answers result = connectAndVent(*driver, scene);
  while (!result.reason.empty() && steadyNow() < begin + kTrying) {
    std::this_thread::sleep_for(kBetweenVents);
    result = connectAndVent(*driver, scene);
  }
  const std::string line = std::string("guard: the process that moved the arm ") +
                           (end == End::kStandsStill ? "did not respond and was killed; "
                                                     : "ended without venting it; ") +
                           regulator::describe(*scene.regulator);
  if (result.reason.empty()) {
    std::cerr << line + basics::format(" is vented, after %g s\n", steadyNow() - begin);
    return kDone;
  }
  std::cerr << line + " is NOT vented: " + result.reason +
                   "; the arm may be under pressure: shut the supply, open the relief valve by "
                   "hand, then `helix_arm regulator " +
                   options.scene + " vent`\n";
  return kNotPossible;
}

std::unique_ptr<simulation::EmulatedDevice> emulate(const io::Scene& scene) {
  const regulator::DeviceFacts facts = regulator::factsOf(*scene.regulator);
  if (!regulator::isHardware(*scene.regulator)) {
    const std::vector<std::string> kinds(std::begin(regulator::kKinds) + 1,
                                         std::end(regulator::kKinds));
    throw CallerError(
        "scene " + scene.name +
        " has a simulated regulator, hence no device to emulate; expected regulator." +
        basics::joined(kinds, " or regulator."));
  }
  refuseIf(!facts.host.empty() && facts.host != "127.0.0.1" && facts.host != "localhost",
           "emulate listens on 127.0.0.1, but the scene's regulator is at ", facts.host,
           "; add --set regulator.", facts.kind, ".host=127.0.0.1");
  simulation::EmulatedDeviceConfig config;
  config.regulator = *scene.regulator;
  config.channels = facts.used(scene.arm.actuatorCount());
  config.valves.supply_pressure =
      std::max(config.valves.supply_pressure, kSupplyAbove * scene.arm.inputAt(1).maxCoeff());
  config.valves.noise = kNoise;
  return std::make_unique<simulation::EmulatedDevice>(config);
}

const char* wordOf(Valve valve) {
  if (valve == Valve::kVent) return "vents";
  return valve == Valve::kRegulate ? "regulates" : "is closed";
}

void tell(const simulation::EmulatedDevice& device, const io::Scene& scene) {
  const regulator::DeviceFacts facts = regulator::factsOf(*scene.regulator);
  const Eigen::VectorXd pressure = device.pressure();
  const Eigen::VectorXd set_point = device.setPoint();
  const std::vector<Valve> valves = device.valves();
  std::vector<std::string> parts;
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    const int k = facts.place(i);
    parts.push_back(scene.arm.actuator(i).name +
                    basics::format(" %s: set %.1f, has %.1f kPa",
                                   wordOf(valves[static_cast<std::size_t>(k)]), set_point[k] / 1e3,
                                   pressure[k] / 1e3));
  }
  std::cout << basics::joined(parts) << std::endl;
}

void obey(const std::string& word, simulation::EmulatedDevice& device) {
  if (const auto fault = simulation::parseDeviceFault(word)) {
    device.setFault(*fault);
    std::cout << "fault: " << word << std::endl;
  } else {
    std::cerr << "unknown fault " << word << "; expected one of " << simulation::deviceFaultNames()
              << "\n";
  }
}

// Reads stdin line by line, until its end.
class Lines {
 public:
  // Waits for lines, at most this long [s].
  std::vector<std::string> await(double seconds) {
    pollfd waited{open_ ? STDIN_FILENO : -1, POLLIN, 0};
    if (poll(&waited, 1, static_cast<int>(std::ceil(1e3 * std::max(seconds, 0.0)))) <= 0) return {};
    char bytes[256];
    const ssize_t size = read(STDIN_FILENO, bytes, sizeof bytes);
    if (size == 0 || (size < 0 && errno != EINTR)) open_ = false;
    if (size > 0) begun_.append(bytes, static_cast<std::size_t>(size));
    std::vector<std::string> lines;
    for (std::size_t end; (end = begun_.find('\n')) != std::string::npos;) {
      if (end > 0) lines.push_back(begun_.substr(0, end));
      begun_.erase(0, end + 1);
    }
    return lines;
  }

 private:
  bool open_ = true;
  std::string begun_;
};

int emulateRegulator(const RegulatorOptions& options, const GlobalOptions& global) {
  refuseIf(global.format != Format::kText, "emulate prints only text; leave out --format");
  const io::Scene scene = loadRegulatedScene(options, global);
  const InterruptWatch watch;
  const auto device = emulate(scene);
  std::cout << "emulates " << regulator::describe(*scene.regulator)
            << "; faults by name on stdin, Ctrl-C ends" << std::endl;
  const double end = steadyNow() + options.seconds.value_or(kNever);
  Lines lines;
  double next = steadyNow();
  while (!interrupted() && steadyNow() < end) {
    if (steadyNow() >= next) {
      tell(*device, scene);
      next += kBetweenReports;
    }
    for (const std::string& line : lines.await(std::min(next, end) - steadyNow())) {
      obey(line, *device);
    }
  }
  return kDone;
}

std::string footer() {
  return R"(set vents at its end, on Ctrl-C and on any fault of the scene's key safety. Hardware
moves only with --yes.
guard ignores signals. A byte q on its stdin dismisses it; if stdin ends without one, it
vents, trying for 10 s. After any other byte it expects one every 0.1 s; if ten in a row
are missing, it kills the process at the other end of its socket, then vents. Through a
socket it sends back what it reads, to show that it is running.
emulate takes names of faults on stdin, one per line. It prints set points, pressures
and valves every second. A serial device holds its pressures if no line comes,
unless its profile has watchdog_s, as generic has.
faults: )" +
         simulation::deviceFaultNames() + R"(
json: probe: regulator, channels [{name, address, pressure_pa, readings}], supply_pa,
seconds, reason;
set: target_pa, pressure_pa (before it vented), state, reason; vent: vented, pressure_pa, reason.
Exit code 0: done. 1: no link, no reading, a fault, or pressure that remains; the reason
is in the result and on stderr. 2: the call is wrong.)";
}

}  // namespace

void addRegulator(Commands& commands) {
  Commands group = commands.group("regulator", "commission the scene's pressure regulator");
  const auto shared = std::make_shared<RegulatorOptions>();
  addScene(group.app(), shared->scene);
  const auto addSeconds = [&shared](CLI::App& command, const char* help) {
    addOption(command, "--seconds", shared->seconds, help, TypeName{"S"},
              CLI::Range(0.01, kLongestRun));
  };
  addSeconds(
      group
          .add("probe", "connect (which vents) and read: which channels answer, and how often",
               probeRegulator, shared)
          .command,
      "time to read [s], default 1");
  auto [set, options] = group.add(
      "set", "go to pressures within limits and slew, hold them, and vent", setRegulator, shared);
  addOption(set, "--pressure-kpa", options.pressure.kpa,
            "gauge pressures [kPa], one per actuator, separated by commas", kRequired,
            TypeName{"A,B,.."});
  set.add_flag("--yes", options.yes, "confirms that air may move and the arm is clear of people");
  addSeconds(set, "time to hold the set points once they are reached [s], default 5");
  group.add("vent",
            "connect, vent, and wait until every channel is within safety.vented_below_kpa of the "
            "atmosphere",
            ventRegulator, shared);
  addOption(group
                .add("guard",
                     "wait for the end of stdin, then vent; started by the node that moves the arm",
                     guardRegulator, shared)
                .command,
            "--realtime-priority", options.realtime_priority,
            "real-time priority (SCHED_FIFO), if the user's limits allow it; default 0: none",
            TypeName{"N"}, CLI::Range(0, regulator::kHighestRealtimePriority));
  addSeconds(group
                 .add("emulate", "emulate the device at its address on this machine",
                      emulateRegulator, shared)
                 .command,
             "time to run [s], default: until Ctrl-C");
  group.app().footer(footer());  // last: commands below would have it, too
}

}  // namespace helix_arm::cli
