#include <algorithm>
#include <cmath>
#include <exception>
#include <filesystem>
#include <functional>
#include <iostream>
#include <memory>
#include <type_traits>
#include <variant>
#include <vector>

#include <unistd.h>

#include "arguments.hpp"
#include "command.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/number.hpp"
#include "helix_arm/io/regulator_profile.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/new_scene.hpp"
#include "output.hpp"

namespace helix_arm::cli {
namespace {

using nlohmann::json;
using procedures::NewScene;

struct NewArguments {
  NewScene scene;
  std::string out;
  bool defaults = false, force = false;
  CLI::App* command = nullptr;
};

// "simulated, none, alicat, .."
std::string regulators() {
  std::string names = "simulated, none";
  for (const std::string& profile : io::shippedProfiles()) names += ", " + profile;
  return names;
}

// A path becomes absolute: a scene counts it from its own folder.
void settleRegulator(NewScene& scene) {
  if (!scene.isHardware()) return;
  if (io::isProfilePath(scene.regulator)) {
    scene.regulator = std::filesystem::absolute(scene.regulator).lexically_normal().string();
  } else {
    const std::vector<std::string> shipped = io::shippedProfiles();
    if (std::find(shipped.begin(), shipped.end(), scene.regulator) == shipped.end()) {
      throw CallerError("--regulator is " + scene.regulator + "; expected " + regulators() +
                        ", or the path of a profile (with a / or ending in .yaml)");
    }
  }
  io::loadRegulatorProfile(scene.regulator);  // throws on a fault of its file
}

bool given(const NewArguments& arguments, const char* option) {
  return arguments.command->count(option) > 0;
}

// What the device takes, where no option says otherwise.
void proposePressure(NewArguments& arguments) {
  NewScene& scene = arguments.scene;
  if (!scene.isHardware() || given(arguments, "--max-pressure-kpa")) return;
  const double highest = std::visit([](const auto& profile) { return profile.highestPressure(); },
                                    io::loadRegulatorProfile(scene.regulator));
  scene.max_pressure_kpa = std::min(scene.max_pressure_kpa, io::kilopascals(highest));
}

// What fits on the arm and is read by the camera, where no option says otherwise. The number of
// tags that an option asks for must fit.
void proposeTags(NewArguments& arguments) {
  NewScene& scene = arguments.scene;
  if (given(arguments, "--tag-size-m")) return;
  const double fitting = scene.fittingTagSize();
  if (fitting > 0 || !given(arguments, "--tags")) scene.tag_size = fitting;
}

// Why a scene that was to have tags has none, on stderr.
void tellOfNoTags(const NewArguments& arguments) {
  if (arguments.scene.tag_size > 0 || given(arguments, "--tag-size-m")) return;
  NewScene least = arguments.scene;
  least.tag_size = procedures::kLeastTagSize;
  try {
    least.validate();
  } catch (const std::invalid_argument& reason) {
    std::cerr << "the scene has neither tags nor camera, since no tags fit. " << reason.what()
              << "\n";
  }
}

bool speaksSerial(const NewScene& scene) {
  return std::holds_alternative<regulator::SerialProfile>(
      io::loadRegulatorProfile(scene.regulator));
}

// A line of the terminal.
std::string askedFor(const std::string& question, const std::string& usual) {
  std::cerr << question << " [" << usual << "]: " << std::flush;
  std::string line;
  if (std::getline(std::cin, line)) return line;
  std::cerr << "\n";
  throw CallerError(
      "the answers end before the last question, so that nothing is written; answer all, or give "
      "--defaults");
}

// Asks for what no option gave, until the answer keeps its rule. What is proposed keeps it: else
// the fault is in the options, where no answer mends it, and is thrown.
class Interview {
 public:
  explicit Interview(const CLI::App& command) : command_(command) {}

  /// @param check  throws, naming the rule that the value breaks.
  template <class Number>
  void ask(const char* option, const std::string& question, Number& value,
           const std::function<void()>& check) const {
    if (command_.count(option) > 0) return;
    const std::string usual = io::formatNumber(static_cast<double>(value));
    repeat(question, usual, value, check, [&value](const std::string& line) {
      const auto number = io::parseNumber(line);
      if (!number) throw CallerError(line + " is not a number; expected one such as 0.3");
      if (std::is_integral_v<Number> &&
          !(std::floor(*number) == *number && std::abs(*number) <= kMostWhole)) {
        throw CallerError(line + " is not a whole number; expected one such as 3");
      }
      value = static_cast<Number>(*number);
    });
  }

  void ask(const char* option, const std::string& question, std::string& value,
           const std::function<void()>& check) const {
    if (command_.count(option) > 0) return;
    repeat(question, value, value, check, [&value](const std::string& line) { value = line; });
  }

 private:
  static constexpr double kMostWhole = 1e6;

  template <class Value, class Take>
  static void repeat(const std::string& question, const std::string& usual, Value& value,
                     const std::function<void()>& check, const Take& take) {
    check();
    const Value before = value;
    for (;;) {
      const std::string line = trimmed(askedFor(question, usual));
      try {
        if (!line.empty()) take(line);
        check();
        return;
      } catch (const std::exception& fault) {
        std::cerr << "  " << fault.what() << "\n";
        value = before;
      }
    }
  }

  static std::string trimmed(const std::string& line) {
    const char* const kBlank = " \t\r";
    const std::size_t first = line.find_first_not_of(kBlank);
    if (first == std::string::npos) return "";
    return line.substr(first, line.find_last_not_of(kBlank) - first + 1);
  }

  const CLI::App& command_;
};

void interview(NewArguments& arguments) {
  const Interview interview(*arguments.command);
  NewScene& scene = arguments.scene;
  const auto in_range = [&scene] {
    scene.validateRanges();
    scene.validateRegulator();
  };
  const auto fits = [&scene] { scene.validate(); };
  std::cerr << "A new arm that hangs before a webcam, in " << arguments.out
            << ". Enter keeps the value in brackets; Ctrl-C leaves without a file.\n";
  interview.ask("--sections", "number of sections, one below the other (1 to 16)", scene.sections,
                in_range);
  interview.ask("--muscles", "number of muscles per section (3 to 24)", scene.muscles, in_range);
  interview.ask("--length-m", "length of a muscle without pressure, in m (0.02 to 5)", scene.length,
                in_range);
  interview.ask(
      "--contraction",
      "by how much it shortens at its highest pressure, as a part of its length (0.01 to 0.5)",
      scene.contraction, in_range);
  interview.ask("--radius-m", "from the arm's centre line to that of a muscle, in m (0.002 to 1)",
                scene.radius, in_range);
  interview.ask(
      "--tilt-deg",
      "tilt of the muscles, in degrees (-60 to 60; 0: along the arm, else wound around it)",
      scene.tilt_deg, in_range);
  interview.ask("--max-pressure-kpa", "highest gauge pressure, in kPa (1 to 2000)",
                scene.max_pressure_kpa, in_range);
  proposeTags(arguments);
  fits();  // else the options do not fit the answers, which no question mends
  interview.ask(
      "--tag-size-m",
      "outer edge of the tags' black border, in m (0.005 to 0.3; 0: neither tags nor camera)",
      scene.tag_size, fits);
  if (scene.tag_size > 0) {
    interview.ask("--tags", "number of tags per muscle (2 to 20; 0: as many as fit, at most 7)",
                  scene.tags, fits);
    interview.ask(
        "--camera-distance-m",
        "from the arm to the camera, in m (0.1 to 10; 0: so that the arm fits the picture)",
        scene.camera_distance, fits);
  }
  interview.ask("--regulator", "pressure regulator: " + regulators() + ", or the path of a profile",
                scene.regulator, [&scene] {
                  settleRegulator(scene);
                  scene.validateRegulator();
                });
  if (!scene.isHardware()) return;
  const auto loads = [&arguments] {
    io::sceneOfText(procedures::newSceneText(arguments.scene), arguments.out);
  };
  if (speaksSerial(scene)) {
    interview.ask("--device", "serial device of the regulator", scene.device, loads);
  } else {
    interview.ask("--host", "name or address of the regulator", scene.host, loads);
  }
}

// What is wrong before anything is asked.
void check(NewArguments& arguments) {
  namespace fs = std::filesystem;
  const fs::path out = arguments.out;
  requireYaml(arguments.out);
  if (fs::exists(out) && !arguments.force) {
    throw CallerError("--out " + arguments.out +
                      " exists; choose another file, or give --force to replace it");
  }
  if (!out.parent_path().empty() && !fs::is_directory(out.parent_path())) {
    throw CallerError("--out " + arguments.out + " is in no folder that exists; create " +
                      out.parent_path().string() + ", or choose another file");
  }
  arguments.scene.validateRanges();
  settleRegulator(arguments.scene);
  proposePressure(arguments);
  arguments.scene.validateRegulator();
  NewScene usual;
  usual.name = arguments.scene.name;
  io::sceneOfText(procedures::newSceneText(usual),
                  arguments.out);  // what is wrong can only be the name
}

int run(NewArguments& arguments, const GlobalOptions& global) {
  if (!global.overrides.empty()) {
    throw CallerError("--set changes a key of a scene, and new writes one; leave out --set");
  }
  NewScene& scene = arguments.scene;
  scene.name = std::filesystem::path(arguments.out).stem().string();
  check(arguments);
  if (!arguments.defaults && isatty(STDIN_FILENO) != 0) {
    interview(arguments);
  } else {
    proposeTags(arguments);
  }
  const bool serial = scene.isHardware() && speaksSerial(scene);
  if (given(arguments, "--device") && !serial) {
    throw CallerError("--device goes with a --regulator on a serial line, such as generic");
  }
  if (given(arguments, "--host") && (serial || !scene.isHardware())) {
    throw CallerError("--host goes with a --regulator on Modbus TCP, such as festo_vtem");
  }
  const std::string text = procedures::newSceneText(scene);
  const io::Scene made = io::sceneOfText(text, arguments.out);
  io::writeFileAtomically(arguments.out, text);
  tellOfNoTags(arguments);
  const std::size_t tags = made.tags ? made.tags->tags.size() : 0;
  const json report{{"scene", made.name},
                    {"actuators", made.arm.actuatorCount()},
                    {"tags", tags},
                    {"regulator", scene.regulator},
                    {"out", arguments.out}};
  json shown = report;
  shown["notes"] = {
      "its contraction curve and stiffness are guesses: edit the file, then run helix_arm check " +
      arguments.out};
  printResult(
      global.format, report,
      [&report] {
        return cellsOf(report, {"scene", "actuators", "tags", "regulator", "out"});
      },
      shown);
  return kDone;
}

}  // namespace

Subcommand addNew(CLI::App& app) {
  CLI::App* command = app.add_subcommand("new", "write a commented scene file of a new arm");
  const auto arguments = std::make_shared<NewArguments>();
  arguments->command = command;
  NewScene& scene = arguments->scene;
  addOption(*command, "--out", arguments->out, "scene file to write; its stem is the scene's name",
            kRequired, TypeName{"FILE.yaml"});
  const auto add = [command](const char* name, auto& value, const char* help) {
    addOption(*command, name, value, help, kShowDefault);
  };
  add("--sections", scene.sections, "sections in series, all alike, 1 to 16");
  add("--muscles", scene.muscles, "muscles per section, 3 to 24");
  add("--length-m", scene.length, "length of a muscle at 0 kPa [m]");
  add("--contraction", scene.contraction,
      "by how much it shortens at its highest pressure, as a part of its length");
  add("--radius-m", scene.radius, "from the arm's centre line to that of a muscle [m]");
  add("--tilt-deg", scene.tilt_deg, "tilt of the muscles, which winds them around the arm [deg]");
  add("--max-pressure-kpa", scene.max_pressure_kpa, "highest gauge pressure [kPa]");
  add("--tag-size-m", scene.tag_size,
      "outer edge of the tags' black border [m]; unless given, more for a far camera, less on a "
      "narrow arm; 0: no tags");
  add("--tags", scene.tags, "tags per muscle; 0: as many as fit, at most 7, and 64 in all");
  add("--camera-distance-m", scene.camera_distance,
      "from the arm to the camera [m]; 0: so that the arm fits the picture");
  add("--regulator", scene.regulator,
      "simulated, none, a shipped profile such as generic (the board), or the path of a profile");
  add("--device", scene.device, "serial device of a regulator on a serial line");
  add("--host", scene.host, "name or address of a regulator on Modbus TCP");
  command->add_flag("--defaults", arguments->defaults,
                    "ask nothing; without it, a terminal is asked for what no option gives");
  command->add_flag("--force", arguments->force, "replace FILE.yaml if it exists");
  command->footer(
      R"(The arm hangs; a webcam looks at it from the side. Each muscle carries a row of tags.
json: scene, actuators, tags (numbers), regulator, out. csv: one row of the same.)");
  return {command, [arguments](const GlobalOptions& global) { return run(*arguments, global); }};
}

}  // namespace helix_arm::cli
