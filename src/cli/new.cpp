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
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/number.hpp"
#include "helix_arm/io/regulator_profile.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/report_plot.hpp"
#include "output.hpp"

namespace helix_arm::cli {
namespace {

using nlohmann::json;

// An arm as its builder describes it. scripts/new_scene says what fits, and writes the scene.
struct NewArm {
  int sections = 1, muscles = 3, tags = 0;
  double length = 0.3, contraction = 0.2, radius = 0.025, tilt_deg = 0, max_pressure_kpa = 300;
  double tag_size = 0.03, camera_distance = 0;
  // "simulated", "none", or a profile as io::loadRegulatorProfile() takes it, its path absolute.
  std::string regulator = "simulated";
  std::string device = "/dev/serial/by-id/usb-YOUR_BOARD", host = "192.168.1.10";

  bool isHardware() const { return regulator != "simulated" && regulator != "none"; }
};

// A number that describes the arm: its option and question, and its rule.
struct Figure {
  const char *option, *help, *question;
  std::variant<int NewArm::*, double NewArm::*> member;
  double least, most;
  const char* rule;
  bool may_be_0 = false;  // which leaves the choice to the command
};
const char* const kTagSize = "--tag-size-m";
const Figure kFigures[] = {
    {"--sections", "sections in series, all alike, 1 to 16",
     "number of sections, one below the other (1 to 16)", &NewArm::sections, 1, 16, "1 to 16"},
    {"--muscles", "muscles per section, 3 to 24", "number of muscles per section (3 to 24)",
     &NewArm::muscles, 3, 24, "3 to 24 per section; write other arms by hand"},
    {"--length-m", "length of a muscle at 0 kPa [m]",
     "length of a muscle without pressure, in m (0.02 to 5)", &NewArm::length, 0.02, 5,
     "0.02 to 5 m"},
    {"--contraction", "by how much it shortens at its highest pressure, as a part of its length",
     "by how much it shortens at its highest pressure, as a part of its length (0.01 to 0.5)",
     &NewArm::contraction, 0.01, 0.5, "0.01 to 0.5 of the length"},
    {"--radius-m", "from the arm's centre line to that of a muscle [m]",
     "from the arm's centre line to that of a muscle, in m (0.002 to 1)", &NewArm::radius, 0.002, 1,
     "0.002 to 1 m"},
    {"--tilt-deg", "tilt of the muscles, which winds them around the arm [deg]",
     "tilt of the muscles, in degrees (-60 to 60; 0: along the arm, else wound around it)",
     &NewArm::tilt_deg, -60, 60, "-60 to 60 degrees"},
    {"--max-pressure-kpa", "highest gauge pressure [kPa]",
     "highest gauge pressure, in kPa (1 to 2000)", &NewArm::max_pressure_kpa, 1, 2000,
     "1 to 2000 kPa"},
    {kTagSize,
     "outer edge of the tags' black border [m]; unless given, more for a far camera, less on a "
     "narrow arm; 0: no tags",
     "outer edge of the tags' black border, in m (0.005 to 0.3; 0: neither tags nor camera)",
     &NewArm::tag_size, 0.005, 0.3, "0.005 to 0.3 m, or 0 for no tags", true},
    {"--tags", "tags per muscle; 0: as many as fit, at most 7, and 64 in all",
     "number of tags per muscle (2 to 20; 0: as many as fit, at most 7)", &NewArm::tags, 2, 20,
     "2 to 20 per muscle, or 0 for as many as fit", true},
    {"--camera-distance-m", "from the arm to the camera [m]; 0: so that the arm fits the picture",
     "from the arm to the camera, in m (0.1 to 10; 0: so that the arm fits the picture)",
     &NewArm::camera_distance, 0.1, 10, "0.1 to 10 m, or 0 so that the arm fits the picture",
     true}};

struct NewArguments {
  NewArm arm;
  std::string out;
  bool defaults = false, force = false;
  CLI::App* command = nullptr;

  bool given(const char* option) const { return command->count(option) > 0; }
};

// Whether a figure is of the tags or of the camera that looks at them.
bool isOfTags(const Figure& figure) { return figure.may_be_0; }

void requireRanges(const NewArm& arm) {
  for (const Figure& figure : kFigures) {
    if (arm.tag_size == 0 && figure.member == decltype(figure.member)(&NewArm::tags)) continue;
    std::visit(
        [&](auto member) {
          const double value = arm.*member;
          const bool sound = value >= figure.least && value <= figure.most;
          basics::requireValue(sound || (figure.may_be_0 && value == 0), "helix_arm new",
                               figure.option, arm.*member, figure.rule);
        },
        figure.member);
  }
}

// "simulated, none, alicat, .."
std::string regulators() {
  std::string names = "simulated, none";
  for (const std::string& profile : io::shippedProfiles()) names += ", " + profile;
  return names;
}

// A path becomes absolute: a scene counts it from its own folder.
void settleRegulator(NewArm& arm) {
  if (!arm.isHardware()) return;
  if (io::isProfilePath(arm.regulator)) {
    arm.regulator = std::filesystem::absolute(arm.regulator).lexically_normal().string();
  } else {
    const std::vector<std::string> shipped = io::shippedProfiles();
    if (std::find(shipped.begin(), shipped.end(), arm.regulator) == shipped.end()) {
      throw CallerError("--regulator is " + arm.regulator + "; expected " + regulators() +
                        ", or the path of a profile (with a / or ending in .yaml)");
    }
  }
  io::loadRegulatorProfile(arm.regulator);  // throws on a fault of its file
}

// What scripts/new_scene has to know of the regulator's device; null of none.
json profileOf(const NewArm& arm) {
  if (!arm.isHardware()) return nullptr;
  const io::RegulatorProfile profile = io::loadRegulatorProfile(arm.regulator);
  const auto* serial = std::get_if<regulator::SerialProfile>(&profile);
  return std::visit(
      [serial](const auto& device) {
        return json{{"serial", serial != nullptr},
                    {"has_addresses",
                     serial != nullptr && serial->write.find("{address}") != std::string::npos},
                    {"highest_kpa", io::kilopascals(device.highestPressure())},
                    {"channels", device.channels ? json(*device.channels) : json()}};
      },
      profile);
}

// The scene as scripts/new_scene writes it: {text, tag_size_m, why_no_tags}.
// @param proposes  the size of the tags may change to what fits on the arm and the camera reads.
// @throws std::invalid_argument naming the options of what does not fit, its rule and the remedy.
json sceneOf(const NewArguments& arguments, const NewArm& arm, bool proposes = false) {
  const json profile = profileOf(arm);
  const bool serial = !profile.is_null() && profile["serial"];
  json report{{"name", std::filesystem::path(arguments.out).stem().string()},
              {"tag_size_proposed", proposes},
              {"regulator", arm.regulator},
              {"regulator_text", io::yamlText(arm.regulator)},
              {"address", io::yamlText(serial ? arm.device : arm.host)},
              {"profile", profile}};
  for (const Figure& figure : kFigures) {
    std::string key = figure.option + 2;
    std::replace(key.begin(), key.end(), '-', '_');
    std::visit([&](auto member) { report[key] = arm.*member; }, figure.member);
  }
  return json::parse(procedures::runScript(
      "new_scene", report.dump(-1, ' ', false, json::error_handler_t::replace), {},
      "the script new_scene failed; check that python3 and the package are completely installed"));
}

bool speaksSerial(const NewArm& arm) { return arm.isHardware() && profileOf(arm)["serial"]; }

template <class Value>
Value valueOf(const std::string& line) {
  if constexpr (std::is_same_v<Value, std::string>) {
    return line;
  } else {
    constexpr double kMostWhole = 1e6;
    const auto number = io::parseNumber(line);
    if (!number) throw CallerError(line + " is not a number; expected one such as 0.3");
    if (std::is_integral_v<Value> &&
        !(std::floor(*number) == *number && std::abs(*number) <= kMostWhole)) {
      throw CallerError(line + " is not a whole number; expected one such as 3");
    }
    return static_cast<Value>(*number);
  }
}

// A line of the terminal.
std::string answerTo(const std::string& question) {
  std::cerr << question << std::flush;
  std::string line;
  if (!std::getline(std::cin, line)) {
    std::cerr << "\n";
    throw CallerError(
        "the answers end before the last question, so that nothing is written; answer all, or give "
        "--defaults");
  }
  const char* const kBlank = " \t\r";
  line.erase(0, line.find_first_not_of(kBlank));
  return line.erase(line.find_last_not_of(kBlank) + 1);
}

// Asks for what no option gave, until the answer keeps its rule. What is proposed keeps it: else
// the fault is in the options, where no answer mends it, and is thrown.
// @param check  throws, naming the rule that the value breaks.
template <class Value>
void ask(const NewArguments& arguments, const char* option, const std::string& question,
         Value& value, const std::function<void()>& check) {
  if (arguments.given(option)) return;
  check();
  const Value before = value;
  std::string usual;
  if constexpr (std::is_same_v<Value, std::string>) {
    usual = value;
  } else {
    usual = io::formatNumber(value);
  }
  for (;;) {
    const std::string line = answerTo(question + " [" + usual + "]: ");
    try {
      if (!line.empty()) value = valueOf<Value>(line);
      return check();
    } catch (const std::exception& fault) {
      std::cerr << "  " << fault.what() << "\n";
      value = before;
    }
  }
}

void interview(NewArguments& arguments) {
  NewArm& arm = arguments.arm;
  const auto check = [&](bool with_tags) {
    requireRanges(arm);
    NewArm checked = arm;
    if (!with_tags) checked.tag_size = 0;
    if (with_tags || arm.isHardware()) sceneOf(arguments, checked);
  };
  std::cerr << "A new arm that hangs before a webcam, in " << arguments.out
            << ". Enter keeps the value in brackets; Ctrl-C leaves without a file.\n";
  for (const Figure& figure : kFigures) {
    const bool of_tags = isOfTags(figure), of_size = figure.option == kTagSize;
    if (of_size) {
      if (!arguments.given(kTagSize)) arm.tag_size = sceneOf(arguments, arm, true)["tag_size_m"];
      check(true);  // else the options do not fit the answers, which no question mends
    }
    if (of_tags && !of_size && arm.tag_size == 0) continue;
    std::visit(
        [&](auto member) {
          ask(arguments, figure.option, figure.question, arm.*member, [&] { check(of_tags); });
        },
        figure.member);
  }
  ask(arguments, "--regulator",
      "pressure regulator: " + regulators() + ", or the path of a profile", arm.regulator, [&] {
        settleRegulator(arm);
        check(false);
      });
  if (!arm.isHardware()) return;
  const auto loads = [&] { io::sceneOfText(sceneOf(arguments, arm)["text"], arguments.out); };
  if (speaksSerial(arm)) {
    ask(arguments, "--device", "serial device of the regulator", arm.device, loads);
  } else {
    ask(arguments, "--host", "name or address of the regulator", arm.host, loads);
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
  NewArm& arm = arguments.arm;
  requireRanges(arm);
  settleRegulator(arm);
  if (arm.isHardware()) {
    const double highest = profileOf(arm)["highest_kpa"];
    if (!arguments.given("--max-pressure-kpa")) {
      arm.max_pressure_kpa = std::min(arm.max_pressure_kpa, highest);
    }
    NewArm without_tags = arm;
    without_tags.tag_size = 0;
    sceneOf(arguments, without_tags);  // throws on what the device does not take
  }
  // What is wrong with this can only be the name.
  io::sceneOfText(sceneOf(arguments, NewArm())["text"], arguments.out);
}

int run(NewArguments& arguments, const GlobalOptions& global) {
  if (!global.overrides.empty()) {
    throw CallerError("--set changes a key of a scene, and new writes one; leave out --set");
  }
  NewArm& arm = arguments.arm;
  check(arguments);
  const bool asks = !arguments.defaults && isatty(STDIN_FILENO) != 0;
  if (asks) interview(arguments);
  const bool serial = speaksSerial(arm);
  if (arguments.given("--device") && !serial) {
    throw CallerError("--device goes with a --regulator on a serial line, such as generic");
  }
  if (arguments.given("--host") && (serial || !arm.isHardware())) {
    throw CallerError("--host goes with a --regulator on Modbus TCP, such as festo_vtem");
  }
  const json scene = sceneOf(arguments, arm, !asks && !arguments.given(kTagSize));
  const std::string text = scene["text"];
  const io::Scene made = io::sceneOfText(text, arguments.out);
  io::writeFileAtomically(arguments.out, text);
  if (scene["tag_size_m"] == 0 && !arguments.given(kTagSize) && !scene["why_no_tags"].is_null()) {
    std::cerr << "the scene has neither tags nor camera, since no tags fit. "
              << scene["why_no_tags"].get<std::string>() << "\n";
  }
  const json report{{"scene", made.name},
                    {"actuators", made.arm.actuatorCount()},
                    {"tags", made.tags ? made.tags->tags.size() : 0},
                    {"regulator", arm.regulator},
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
  NewArm& arm = arguments->arm;
  addOption(*command, "--out", arguments->out, "scene file to write; its stem is the scene's name",
            kRequired, TypeName{"FILE.yaml"});
  for (const Figure& figure : kFigures) {
    std::visit(
        [&](auto member) {
          addOption(*command, figure.option, arm.*member, figure.help, kShowDefault);
        },
        figure.member);
  }
  addOption(*command, "--regulator", arm.regulator,
            "simulated, none, a shipped profile such as generic (the board), or the path of a "
            "profile",
            kShowDefault);
  addOption(*command, "--device", arm.device, "serial device of a regulator on a serial line",
            kShowDefault);
  addOption(*command, "--host", arm.host, "name or address of a regulator on Modbus TCP",
            kShowDefault);
  command->add_flag("--defaults", arguments->defaults,
                    "ask nothing; without it, a terminal is asked for what no option gives");
  command->add_flag("--force", arguments->force, "replace FILE.yaml if it exists");
  command->footer(
      R"(The arm hangs; a webcam looks at it from the side. Each muscle carries a row of tags.
json: scene, actuators, tags (numbers), regulator, out. csv: one row of the same.)");
  return {command, [arguments](const GlobalOptions& global) { return run(*arguments, global); }};
}

}  // namespace helix_arm::cli
