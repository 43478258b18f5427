#include <filesystem>
#include <iostream>
#include <memory>

#include <unistd.h>

#include "arguments.hpp"
#include "command.hpp"
#include "completion.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/number.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/new_scene.hpp"
#include "output.hpp"

namespace helix_arm::cli {
namespace {

using procedures::NewScene;

struct NewArguments {
  NewScene scene;
  std::string out, regulator = "simulated";
  bool defaults = false, force = false;
  CLI::App* command = nullptr;
};

// A line of the terminal; empty at its end.
std::string askedFor(const std::string& question, const std::string& usual) {
  std::cerr << question << " [" << usual << "]: " << std::flush;
  std::string line;
  std::getline(std::cin, line);
  return line;
}

// Asks for what no option gave.
class Interview {
 public:
  explicit Interview(const CLI::App& command) : command_(command) {}

  template <class Number>
  void ask(const char* option, const std::string& question, Number& value) const {
    if (command_.count(option) > 0) return;
    for (;;) {
      const std::string line = askedFor(question, io::formatNumber(static_cast<double>(value)));
      if (line.empty()) return;
      const auto number = io::parseNumber(line);
      if (number && static_cast<double>(static_cast<Number>(*number)) == *number) {
        value = static_cast<Number>(*number);
        return;
      }
      std::cerr << "expected a number\n";
    }
  }

  void ask(const char* option, const std::string& question, std::string& value) const {
    if (command_.count(option) > 0) return;
    const std::string line = askedFor(question, value);
    if (!line.empty()) value = line;
  }

 private:
  const CLI::App& command_;
};

void interview(NewArguments& arguments) {
  const Interview interview(*arguments.command);
  NewScene& scene = arguments.scene;
  std::cerr << "Enter keeps the value in brackets.\n";
  interview.ask("--sections", "sections in series", scene.sections);
  interview.ask("--muscles", "muscles per section", scene.muscles);
  interview.ask("--length-m", "length of a muscle at 0 kPa [m]", scene.length);
  interview.ask("--contraction", "by how much it shortens, as a part of its length",
                scene.contraction);
  interview.ask("--radius-m", "from the arm's centre line to a muscle's [m]", scene.radius);
  interview.ask("--tilt-deg", "tilt of the muscles around the arm [deg]", scene.tilt_deg);
  interview.ask("--max-pressure-kpa", "highest pressure [kPa]", scene.max_pressure_kpa);
  interview.ask("--tag-size-m", "tags, black edge [m]; 0: none", scene.tag_size);
  if (scene.tag_size > 0) {
    interview.ask("--tags", "tags per muscle; 0: as many as fit", scene.tags);
    interview.ask("--camera-distance-m", "camera from the arm [m]; 0: so that it fits",
                  scene.camera_distance);
  }
  interview.ask("--regulator", "regulator: simulated, generic or none", arguments.regulator);
  if (arguments.regulator == "generic") interview.ask("--device", "its device", scene.device);
}

NewScene::Regulator regulatorNamed(const std::string& name) {
  if (name == "simulated") return NewScene::Regulator::kSimulated;
  if (name == "generic") return NewScene::Regulator::kGeneric;
  if (name == "none") return NewScene::Regulator::kNone;
  throw CallerError("regulator is " + name + "; expected simulated, generic or none");
}

int run(NewArguments& arguments, const GlobalOptions& global) {
  namespace fs = std::filesystem;
  if (!global.overrides.empty()) {
    throw CallerError("--set changes a key of a scene, and new writes one; leave out --set");
  }
  requireYaml(arguments.out);
  if (fs::exists(arguments.out) && !arguments.force) {
    throw CallerError("--out " + arguments.out +
                      " exists; choose another file, or give --force to replace it");
  }
  if (!arguments.defaults && isatty(STDIN_FILENO) != 0) interview(arguments);
  NewScene& scene = arguments.scene;
  scene.name = fs::path(arguments.out).stem().string();
  scene.regulator = regulatorNamed(arguments.regulator);
  if (arguments.command->count("--device") > 0 &&
      scene.regulator != NewScene::Regulator::kGeneric) {
    throw CallerError("--device goes with --regulator generic");
  }
  const std::string text = procedures::newSceneText(scene);
  const io::Scene made = io::sceneOfText(text, arguments.out);
  io::writeFileAtomically(arguments.out, text);
  const std::size_t tags = made.tags ? made.tags->tags.size() : 0;
  if (global.format == Format::kJson) {
    printJson({{"scene", made.name},
               {"actuators", made.arm.actuatorCount()},
               {"tags", tags},
               {"regulator", arguments.regulator},
               {"out", arguments.out}});
  }
  if (global.format == Format::kCsv) {
    CsvTable table;
    table.add({{"scene", made.name},
               {"actuators", std::to_string(made.arm.actuatorCount())},
               {"tags", std::to_string(tags)},
               {"regulator", arguments.regulator},
               {"out", arguments.out}});
    table.print(std::cout);
  }
  if (global.format == Format::kText) {
    std::cout << "written: " << arguments.out << ", an arm with " << made.arm.actuatorCount()
              << " muscles and " << tags << " tags\n"
              << "Its contraction curve and stiffness are guesses: edit the file, then run "
                 "helix_arm check "
              << arguments.out << "\n";
  }
  return kDone;
}

}  // namespace

Subcommand addNew(CLI::App& app) {
  CLI::App* command = app.add_subcommand("new", "write a commented scene file of a new arm");
  const auto arguments = std::make_shared<NewArguments>();
  arguments->command = command;
  NewScene& scene = arguments->scene;
  command->add_option("--out", arguments->out, "scene file to write; its stem is the scene's name")
      ->required()
      ->type_name("FILE.yaml");
  const auto add = [command](const char* name, auto& value, const char* help) {
    command->add_option(name, value, help)->capture_default_str();
  };
  add("--sections", scene.sections, "sections in series, all alike, 1 to 16");
  add("--muscles", scene.muscles, "muscles per section, 3 to 24");
  add("--length-m", scene.length, "length of a muscle at 0 kPa [m]");
  add("--contraction", scene.contraction,
      "by how much it shortens at its highest pressure, as a part of its length");
  add("--radius-m", scene.radius, "from the arm's centre line to that of a muscle [m]");
  add("--tilt-deg", scene.tilt_deg, "tilt of the muscles, which winds them around the arm [deg]");
  add("--max-pressure-kpa", scene.max_pressure_kpa, "highest gauge pressure [kPa]");
  add("--tag-size-m", scene.tag_size, "outer edge of the tags' black border [m]; 0: no tags");
  add("--tags", scene.tags, "tags per muscle; 0: as many as fit, at most 7");
  add("--camera-distance-m", scene.camera_distance,
      "from the arm to the camera [m]; 0: so that the arm fits the picture");
  add("--regulator", arguments->regulator, "simulated, generic (the board) or none");
  offerWords(command->get_option("--regulator"), {"simulated", "generic", "none"});
  add("--device", scene.device, "serial device of a generic regulator");
  command->add_flag("--defaults", arguments->defaults,
                    "ask nothing; without it, a terminal is asked for what no option gives");
  command->add_flag("--force", arguments->force, "replace FILE.yaml if it exists");
  command->footer(
      "The arm hangs; a webcam looks at it from the side. Each muscle carries a row of tags.\n"
      "json: scene, actuators, tags (numbers), regulator, out. csv: one row of the same.");
  return {command, [arguments](const GlobalOptions& global) { return run(*arguments, global); }};
}

}  // namespace helix_arm::cli
