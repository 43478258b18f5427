#include <chrono>
#include <cmath>
#include <iomanip>
#include <iostream>
#include <limits>
#include <sstream>
#include <thread>
#include <vector>

#include "arguments.hpp"
#include "helix_arm/regulator/realtime.hpp"
#include "helix_arm/regulator/regulator_io.hpp"
#include "helix_arm/simulation/device_fault.hpp"
#include "interrupt_watch.hpp"
#include "output.hpp"
#include "regulator_actions.hpp"

namespace helix_arm::cli {
namespace {

using nlohmann::json;
using regulator::steadyNow;

constexpr double kProbeSeconds = 1;
constexpr double kLongest = 86400;  // [s]
constexpr std::chrono::milliseconds kBetweenReadings(10);
constexpr double kNoReading = std::numeric_limits<double>::quiet_NaN();

struct Probe {
  explicit Probe(int channels)
      : pressure(Eigen::VectorXd::Constant(channels, kNoReading)), readings(channels, 0) {}

  Eigen::VectorXd pressure;   // last readings [Pa]
  std::vector<int> readings;  // (channels)
  double supply = kNoReading;
  double seconds = 0;
  std::string reason;  // cause of failure; empty on success
};

void readOnce(regulator::Driver& driver, Probe& probe) {
  regulator::Pressures pressures(static_cast<int>(probe.pressure.size()));
  driver.read(pressures);
  for (Eigen::Index i = 0; i < probe.pressure.size(); ++i) {
    if (!std::isfinite(pressures.pressure[i])) continue;
    probe.pressure[i] = pressures.pressure[i];
    ++probe.readings[static_cast<std::size_t>(i)];
  }
  if (std::isfinite(pressures.supply)) probe.supply = pressures.supply;
}

Probe probe(const io::Scene& scene, double seconds) {
  const InterruptWatch watch;
  Probe result(scene.arm.actuatorCount());
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

void printProbeText(const io::Scene& scene, const Probe& result) {
  std::cout << regulator::describe(*scene.regulator)
            << ": connected, which vents; nothing else was written\n"
            << std::fixed;
  // Without a line to a device, their rate is that of this computer.
  const bool hardware = regulator::isHardware(*scene.regulator);
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    const int readings = result.readings[static_cast<std::size_t>(i)];
    std::cout << scene.arm.actuator(i).name << " at " << regulator::addressOf(*scene.regulator, i)
              << ": ";
    if (readings == 0) {
      std::cout << "no reading\n";
    } else {
      std::cout << std::setprecision(2) << result.pressure[i] / 1e3 << " kPa";
      if (hardware) {
        std::cout << ", " << std::setprecision(1) << readings / result.seconds
                  << " readings a second";
      }
      std::cout << "\n";
    }
  }
  if (std::isfinite(result.supply)) {
    std::cout << "supply: " << std::setprecision(2) << result.supply / 1e3 << " kPa\n";
  } else {
    std::cout << "supply: not measured\n";
  }
}

void printProbe(const io::Scene& scene, const Probe& result, Format format) {
  json channels = json::array();
  CsvTable table;
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    const std::string& name = scene.arm.actuator(i).name;
    const std::string address = regulator::addressOf(*scene.regulator, i);
    const int readings = result.readings[static_cast<std::size_t>(i)];
    channels.push_back({{"name", name},
                        {"address", address},
                        {"pressure_pa", readingsJson(result.pressure)[i]},
                        {"readings", readings}});
    table.add({{"name", name},
               {"address", address},
               {"pressure_pa", readingCell(result.pressure[i])},
               {"readings", std::to_string(readings)},
               {"supply_pa", readingCell(result.supply)}});
  }
  if (format == Format::kText && result.seconds > 0) printProbeText(scene, result);
  if (format == Format::kCsv) table.print(std::cout);
  if (format == Format::kJson) {
    printJson({{"regulator", regulator::describe(*scene.regulator)},
               {"channels", channels},
               {"supply_pa", std::isfinite(result.supply) ? json(result.supply) : json(nullptr)},
               {"seconds", result.seconds},
               {"reason", result.reason.empty() ? json(nullptr) : json(result.reason)}});
  }
}

}  // namespace

io::Scene loadRegulatedScene(const RegulatorOptions& options, const GlobalOptions& global) {
  io::Scene scene = loadScene(options.scene, global);
  if (!scene.regulator) {
    throw CallerError("scene " + scene.name +
                      " has no regulator; add the section `regulator` to it");
  }
  return scene;
}

std::unique_ptr<regulator::Driver> makeDriver(const io::Scene& scene) {
  return regulator::makeDriver(*scene.regulator, scene.arm.actuatorCount());
}

Vented ventAll(regulator::Driver& driver, const io::Scene& scene) {
  const int channels = scene.arm.actuatorCount();
  const control::SafetyRules& rules = scene.safety.rules;
  Vented result{Eigen::VectorXd::Constant(channels, kNoReading), {}};
  const double end = steadyNow() + rules.vent_time;
  for (;;) {
    std::string bad_reply;
    try {
      driver.vent();
      regulator::Pressures pressures(channels);
      driver.read(pressures);
      result.pressure =
          pressures.pressure.array().isNaN().select(result.pressure, pressures.pressure);
    } catch (const regulator::BadReply& error) {
      bad_reply = error.what();
    }
    int full = 0;
    while (full < channels && std::abs(result.pressure[full]) <= rules.vented_below) ++full;
    if (full == channels) return result;
    if (steadyNow() >= end) {
      std::ostringstream text;
      text << scene.arm.actuator(full).name;
      if (std::isnan(result.pressure[full])) {
        text << " gives no reading" << (bad_reply.empty() ? "" : ": " + bad_reply);
      } else {
        text << " still has " << result.pressure[full] / 1e3 << " kPa after " << rules.vent_time
             << " s; shut the supply and check for a valve that does not close";
      }
      result.reason = text.str();
      return result;
    }
    std::this_thread::sleep_for(kBetweenReadings);
  }
}

std::string pressureText(const io::Scene& scene, const Eigen::VectorXd& pressure, int decimals) {
  std::ostringstream text;
  text << std::fixed << std::setprecision(decimals);
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    text << (i > 0 ? ", " : "") << scene.arm.actuator(i).name;
    if (std::isfinite(pressure[i])) {
      text << " " << pressure[i] / 1e3 << " kPa";
    } else {
      text << " no reading";
    }
  }
  return text.str();
}

json readingsJson(const Eigen::VectorXd& pressure) {
  json result = json::array();
  for (const double each : pressure) {
    result.push_back(std::isfinite(each) ? json(each) : json(nullptr));
  }
  return result;
}

std::string readingCell(double pressure) {
  return std::isfinite(pressure) ? exact(pressure) : std::string();
}

int probeRegulator(const RegulatorOptions& options, const GlobalOptions& global) {
  const io::Scene scene = loadRegulatedScene(options, global);
  const Probe result = probe(scene, options.seconds.value_or(kProbeSeconds));
  printProbe(scene, result, global.format);
  if (result.reason.empty()) return kDone;
  std::cerr << result.reason << "\n";
  return kNotPossible;
}

int ventRegulator(const RegulatorOptions& options, const GlobalOptions& global) {
  const io::Scene scene = loadRegulatedScene(options, global);
  Vented result{Eigen::VectorXd::Constant(scene.arm.actuatorCount(), kNoReading), {}};
  try {
    const auto driver = makeDriver(scene);
    driver->connect();
    result = ventAll(*driver, scene);
  } catch (const regulator::LinkError& error) {
    result.reason = error.what();
  }
  const bool vented = result.reason.empty();
  if (global.format == Format::kJson) {
    printJson({{"vented", vented},
               {"pressure_pa", readingsJson(result.pressure)},
               {"reason", vented ? json(nullptr) : json(result.reason)}});
  }
  if (global.format == Format::kCsv) {
    CsvTable::Row row{{"vented", vented ? "true" : "false"}};
    for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
      row.emplace_back("pressure_" + std::to_string(i + 1) + "_pa",
                       readingCell(result.pressure[i]));
    }
    CsvTable table;
    table.add(row);
    table.print(std::cout);
  }
  if (global.format == Format::kText && vented) {
    std::cout << "vented, to within " << scene.safety.rules.vented_below / 1e3
              << " kPa of the atmosphere (safety.vented_below_kpa): "
              << pressureText(scene, result.pressure) << "\n";
  }
  if (vented) return kDone;
  std::cerr << "not vented: " << result.reason << "\n";
  return kNotPossible;
}

Subcommand addRegulator(CLI::App& app) {
  CLI::App* command = app.add_subcommand("regulator", "commission the scene's pressure regulator");
  const auto options = std::make_shared<RegulatorOptions>();
  addScene(*command, "SCENE", options->scene, "scene file")->required();
  command->require_subcommand(1);
  using Run = int (*)(const RegulatorOptions&, const GlobalOptions&);
  struct Action {
    CLI::App* app;
    Run run;
  };
  std::vector<Action> actions;
  const auto add = [&](const char* name, const char* help, Run run) {
    actions.push_back({command->add_subcommand(name, help), run});
    return actions.back().app;
  };
  const auto addSeconds = [&options](CLI::App* action, const char* help) {
    action->add_option("--seconds", options->seconds, help)
        ->type_name("S")
        ->check(CLI::Range(0.01, kLongest));
  };
  addSeconds(add("probe", "connect (which vents) and read: which channels answer, and how often",
                 probeRegulator),
             "time to read [s], default 1");
  CLI::App* set =
      add("set", "go to pressures within limits and slew, hold them, and vent", setRegulator);
  set->add_option("--pressure-kpa", options->pressure_kpa,
                  "gauge pressures [kPa], one per actuator, separated by commas")
      ->required()
      ->type_name("A,B,..");
  set->add_flag("--yes", options->yes, "confirms that air may move and the arm is clear of people");
  addSeconds(set, "time to hold the set points once they are reached [s], default 5");
  add("vent",
      "connect, vent, and wait until every channel is within safety.vented_below_kpa of the "
      "atmosphere",
      ventRegulator);
  add("guard", "wait for the end of stdin, then vent; started by the node that moves the arm",
      guardRegulator)
      ->add_option(
          "--realtime-priority", options->realtime_priority,
          "real-time priority (SCHED_FIFO), if the user's limits allow it; default 0: none")
      ->type_name("N")
      ->check(CLI::Range(0, regulator::kHighestRealtimePriority));
  addSeconds(add("emulate", "emulate the device at its address on this machine", emulateRegulator),
             "time to run [s], default: until Ctrl-C");
  command->footer(
      "set vents at its end, on Ctrl-C and on any fault of the scene's key safety. Hardware\n"
      "moves only with --yes.\n"
      "guard ignores signals. A byte q on its stdin dismisses it; if stdin ends without one, it\n"
      "vents, trying for 10 s. After any other byte it expects one every 0.1 s; if ten in a row\n"
      "are missing, it kills the process at the other end of its socket, then vents. Through a\n"
      "socket it sends back what it reads, to show that it is running.\n"
      "emulate takes names of faults on stdin, one per line. It prints set points, pressures\n"
      "and valves every second. A serial device holds its pressures if no line comes,\n"
      "unless its profile has watchdog_s, as generic has.\n"
      "faults: " +
      simulation::deviceFaultNames() +
      "\n"
      "json: probe: regulator, channels [{name, address, pressure_pa, readings}], supply_pa,\n"
      "seconds, reason;\n"
      "set: target_pa, pressure_pa (before it vented), state, reason; vent: vented, pressure_pa, "
      "reason.\n"
      "Exit code 0: done. 1: no link, no reading, a fault, or pressure that remains; the reason\n"
      "is in the result and on stderr. 2: the call is wrong.");
  return {command, [options, actions](const GlobalOptions& global) {
            for (const Action& action : actions) {
              if (action.app->parsed()) return action.run(*options, global);
            }
            return kCallerErred;
          }};
}

}  // namespace helix_arm::cli
