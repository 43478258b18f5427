#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <iomanip>
#include <iostream>
#include <limits>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "arguments.hpp"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/regulator/guard_process.hpp"
#include "helix_arm/regulator/pressure_path.hpp"
#include "interrupt_watch.hpp"
#include "output.hpp"
#include "regulator_actions.hpp"

namespace helix_arm::cli {
namespace {

using control::SafetyCause;
using control::SafetyState;
using nlohmann::json;
using regulator::steadyNow;

constexpr double kStay = 5;            // [s]
constexpr double kBetweenLines = 0.5;  // [s]
constexpr double kLinkTime = 5;        // for a regulator to answer [s]
constexpr double kNever = std::numeric_limits<double>::infinity();
constexpr std::chrono::milliseconds kTurn(5);

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
              << pressureText(scene_, path_.core().reading()) << std::endl;
  }

  const io::Scene& scene_;
  const std::shared_ptr<const regulator::GuardProcess> guard_;
  const bool talks_;
  regulator::PressurePath path_;
  double told_ = 0;
};

void printOutcome(const Outcome& outcome, const io::Scene& scene, const Eigen::VectorXd& target,
                  Format format) {
  if (format == Format::kJson) {
    printJson({{"target_pa", toJson(target)},
               {"pressure_pa", readingsJson(outcome.pressure)},
               {"state", control::nameOf(outcome.state)},
               {"reason", outcome.reason.empty() ? json(nullptr) : json(outcome.reason)}});
  }
  if (format == Format::kCsv) {
    CsvTable table;
    for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
      table.add({{"name", scene.arm.actuator(i).name},
                 {"target_pa", exact(target[i])},
                 {"pressure_pa", readingCell(outcome.pressure[i])},
                 {"state", control::nameOf(outcome.state)}});
    }
    table.print(std::cout);
  }
  if (format == Format::kText) {
    std::cout << "reached " << pressureText(scene, outcome.pressure) << ", then "
              << control::nameOf(outcome.state) << "\n";
  }
}

std::vector<std::string> guardCommand(const RegulatorOptions& options,
                                      const GlobalOptions& global) {
  std::vector<std::string> out = {std::filesystem::read_symlink("/proc/self/exe").string(),
                                  "regulator", options.scene, "guard"};
  for (const std::string& change : global.overrides) {
    out.insert(out.end(), {"--set", change});
  }
  return out;
}

}  // namespace

int setRegulator(const RegulatorOptions& options, const GlobalOptions& global) {
  const io::Scene scene = loadRegulatedScene(options, global);
  const Eigen::VectorXd target =
      inputsOf(scene, "--pressure-kpa", options.pressure_kpa, "--input", "");
  if (regulator::isHardware(*scene.regulator) && !options.yes) {
    throw CallerError("set moves the hardware " + regulator::describe(*scene.regulator) +
                      "; add --yes once nobody is within the arm's reach");
  }
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
  printOutcome(outcome, scene, target, global.format);
  if (outcome.reason.empty()) return kDone;
  std::cerr << outcome.reason << "\n";
  return kNotPossible;
}

}  // namespace helix_arm::cli
