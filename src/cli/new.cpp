#include <Eigen/QR>
#include <algorithm>
#include <exception>
#include <filesystem>
#include <iostream>

#include <unistd.h>

#include "basics/pi.hpp"
#include "command.hpp"
#include "helix_arm/calibration/series_fit.hpp"
#include "io/document/atomic_file.hpp"
#include "io/document/number.hpp"
#include "io/scene/regulator_profile.hpp"
#include "procedures/captures.hpp"
#include "procedures/report_plot.hpp"
#include "procedures/response_series.hpp"

namespace helix_arm::cli {
namespace {

// An arm as its builder describes it. scripts/new_scene asks for it, says what fits, and writes the
// scene.
struct NewArm {
  int sections = 1, muscles = 3, tags = 0;
  double length = 0.3, contraction = 0.2, radius = 0.025, tilt_deg = 0, max_pressure_kpa = 300;
  double tag_size = 0.03, camera_distance = 0;
  bool extending = false, chambers = false;
  std::string mounting = "hanging";
  // "simulated", "none", or a profile as io::loadRegulatorProfile() takes it, its path absolute.
  std::string regulator = "simulated";
  std::string device = "/dev/serial/by-id/usb-YOUR_BOARD", host = "192.168.1.10";

  bool isHardware() const { return regulator != "simulated" && regulator != "none"; }
};

struct Figure {
  const char* option;
  std::variant<int NewArm::*, double NewArm::*> member;
  const char* help;
};
const char* const kTagSize = "--tag-size-m";
const Figure kFigures[] = {
    {"--sections", &NewArm::sections, "sections in series, all alike, 1 to 16"},
    {"--muscles", &NewArm::muscles, "muscles per section, 3 to 24"},
    {"--length-m", &NewArm::length, "length of a muscle at 0 kPa [m]"},
    {"--contraction", &NewArm::contraction,
     "by how much it shortens, or with --extending lengthens, at its highest pressure, as a part "
     "of "
     "its length"},
    {"--radius-m", &NewArm::radius,
     "from the arm's centre line to that of a muscle [m]; with --chambers 0.02 unless given"},
    {"--tilt-deg", &NewArm::tilt_deg, "tilt of the muscles, which winds them around the arm [deg]"},
    {"--max-pressure-kpa", &NewArm::max_pressure_kpa,
     "highest gauge pressure [kPa]; with --extending 100 unless given"},
    {kTagSize, &NewArm::tag_size,
     "outer edge of the tags' black border [m]; unless given, more for a far camera, less on a "
     "narrow arm; 0: no tags"},
    {"--tags", &NewArm::tags, "tags per muscle; 0: as many as fit, at most 7, and 64 in all"},
    {"--camera-distance-m", &NewArm::camera_distance,
     "from the arm to the camera [m]; 0: so that the arm fits the picture"}};

struct NewArguments {
  NewArm arm;
  std::string out, recording;
  std::vector<std::string> known;  // options that the recording gives
  bool defaults = false, force = false;
  CLI::App* command = nullptr;

  bool given(const char* option) const { return command->count(option) > 0; }
  // Takes a value of the recording where no option gives one.
  template <class Value>
  void take(const char* option, Value& to, Value value) {
    if (given(option)) return;
    to = value;
    known.emplace_back(option);
  }
};

// "simulated, none, alicat (psi), .."
std::string regulators() {
  std::string names = "simulated, none";
  for (const std::string& name : io::shippedProfiles()) {
    const regulator::Profile profile = io::loadRegulatorProfile(name);
    const auto* serial = std::get_if<regulator::SerialProfile>(&profile);
    names +=
        ", " + name + (serial != nullptr && serial->pascals == regulator::kPsi ? " (psi)" : "");
  }
  return names;
}

// A path becomes absolute: a scene counts it from its own folder.
void settleRegulator(NewArm& arm) {
  if (!arm.isHardware()) return;
  if (io::isProfilePath(arm.regulator)) {
    arm.regulator = std::filesystem::absolute(arm.regulator).lexically_normal().string();
  } else {
    const std::vector<std::string> shipped = io::shippedProfiles();
    refuseIf(std::find(shipped.begin(), shipped.end(), arm.regulator) == shipped.end(),
             "--regulator is ", arm.regulator, "; expected ", regulators(),
             ", or the path of a profile (with a / or ending in .yaml)");
  }
  io::loadRegulatorProfile(arm.regulator);  // throws on a fault of its file
}

// Facts for scripts/new_scene about the regulator's device; null of none.
json profileOf(const NewArm& arm) {
  if (!arm.isHardware()) return nullptr;
  const regulator::Profile profile = io::loadRegulatorProfile(arm.regulator);
  const auto* serial = std::get_if<regulator::SerialProfile>(&profile);
  return std::visit(
      [serial](const auto& device) {
        return json{{"serial", serial != nullptr},
                    {"has_addresses",
                     serial != nullptr && serial->write.find("{address}") != std::string::npos},
                    {"highest_kpa", io::kilopascals(device.highestPressure())},
                    {"channels", device.channels}};
      },
      profile);
}

std::string keyOf(const char* option) {
  std::string key = option + 2;
  std::replace(key.begin(), key.end(), '-', '_');
  return key;
}

// Start of scripts/new_scene.
json startOf(const NewArguments& arguments, const NewArm& arm, bool asks) {
  const json words{{"regulator", arm.regulator}, {"device", arm.device}, {"host", arm.host}};
  json start = words;
  start.update({{"name", std::filesystem::path(arguments.out).stem().string()},
                {"out", arguments.out},
                {"regulators", regulators()},
                {"usual", words},
                {"given", json::array()},
                {"asks", asks},
                {"extending", arm.extending},
                {"chambers", arm.chambers},
                {"mounting", arm.mounting},
                {"asked", nullptr}});
  for (const Figure& figure : kFigures) {
    std::visit([&](auto member) { start[keyOf(figure.option)] = exact(arm.*member); },
               figure.member);
  }
  for (const CLI::Option* option : arguments.command->get_options()) {
    if (option->count() > 0) start["given"].push_back(keyOf(option->get_name().c_str()));
  }
  for (const std::string& option : arguments.known) start["given"].push_back(keyOf(option.c_str()));
  return start;
}

// The scene as scripts/new_scene writes it, after what it asks: {text, tag_size_m, why_no_tags,
// regulator, serial}; null on Ctrl-C.
// @throws std::invalid_argument naming the options of what does not fit, its rule and the remedy;
// io::DocumentError on a text that is no scene.
json sceneOf(const NewArguments& arguments, NewArm arm, bool asks) {
  const InterruptWatch watch;
  json state = startOf(arguments, arm, asks);
  for (;;) {
    const json profile = profileOf(arm);
    const bool serial = !profile.is_null() && profile["serial"];
    state.update({{"profile", profile},
                  {"regulator_text", io::yamlText(arm.regulator)},
                  {"address", io::yamlText(serial ? arm.device : arm.host)}});
    json answer = json::parse(procedures::runScript(
        "new_scene", state.dump(-1, ' ', false, json::error_handler_t::replace), {},
        "the script new_scene failed; check that the package is completely installed"));
    if (answer.is_null() || interrupted()) return nullptr;
    if (!answer.contains("asked")) {
      try {
        io::sceneOfText(answer["text"], arguments.out);
        return answer;
      } catch (const io::DocumentError& fault) {
        if (state["asked"].is_null()) throw;
        state["fault"] = fault.what();
        continue;
      }
    }
    state = std::move(answer);
    state["fault"] = nullptr;
    arm.device = state["device"];
    arm.host = state["host"];
    arm.regulator = state["regulator"];
    try {
      settleRegulator(arm);
      state["regulator"] = arm.regulator;
    } catch (const std::exception& fault) {
      state["fault"] = fault.what();
      arm.regulator = state["usual"]["regulator"];
    }
  }
}

// Error of the arm of a scene, fitted to a recording, on parts that were left out [m].
double heldOutError(const json& scene, const procedures::ResponseSeries& tips) {
  const io::Scene made = io::sceneOfText(scene["text"], "the scene of the recording");
  estimation::SeriesOptions options;
  options.arm.fit.insert({estimation::FitParameter::kContraction, estimation::FitParameter::kBase});
  const estimation::SeriesFit fit =
      estimation::fitSeries(procedures::priorOf(made), procedures::ofArm(tips), options);
  refuseIf(!fit.failure.empty(), "--recording: ", fit.failure);
  return fit.held_out_rms;
}

// Whether the actuators lengthen: the kind of arm that predicts left-out parts better, by far.
std::optional<bool> lengthens(const NewArguments& arguments, NewArm arm,
                              const procedures::ResponseSeries& tips) {
  constexpr double kFar = 0.7;  // of the other's error
  double errors[2];
  for (const bool extending : {false, true}) {
    arm.extending = extending;
    errors[extending] = heldOutError(sceneOf(arguments, arm, false), tips);
  }
  if (errors[1] < kFar * errors[0]) return true;
  if (errors[0] < kFar * errors[1]) return false;
  return std::nullopt;
}

// Angle between the directions in which two pressures move the tip [rad].
double angleBetween(const procedures::ResponseSeries& tips) {
  Eigen::MatrixXd inputs(tips.history.rows(), 3);
  inputs << tips.history.input.leftCols<2>(), Eigen::VectorXd::Ones(inputs.rows());
  Eigen::MatrixXd tip = tips.reading;
  for (Eigen::Index row = 0; row < tip.rows(); ++row) {
    if (tip.row(row).allFinite()) continue;
    inputs.row(row).setZero();
    tip.row(row).setZero();
  }
  const Eigen::MatrixXd by = inputs.colPivHouseholderQr().solve(tip);
  return std::acos(by.row(0).normalized().dot(by.row(1).normalized()));
}

// Takes from a recording of the tip what it tells of its arm: actuators, highest pressure, kind.
// @return notes.
json takeRecording(NewArguments& arguments) {
  NewArm& arm = arguments.arm;
  const io::DataSet data = io::loadDataSet(arguments.recording);
  refuseIf(procedures::kindOf(data) != procedures::DataKind::kTipSeries, "--recording ", data.path,
           " is no series of the tip; expected time_s, pressure_1_kpa .., x_m, y_m and z_m");
  int count = 0;
  while (data.find("pressure_" + std::to_string(count + 1) + "_kpa") >= 0) ++count;
  refuseIf(count < 2, "--recording ", data.path, " has ", count,
           " columns pressure_1_kpa ..; expected one for each actuator, at least two");
  const procedures::ResponseSeries tips = procedures::tipSeriesOf(data, count);
  const double highest = tips.history.input.maxCoeff(), lowest = tips.history.input.minCoeff();
  refuseIf(
      lowest < -0.1 * highest, "--recording ", data.path, " reaches ", lowest / 1e3,
      " kPa; expected pressures above the atmosphere: write the scene of a vacuum arm by hand");
  json notes = json::array();
  int muscles = count / arm.sections;
  refuseIf(muscles * arm.sections != count, "--sections ", arm.sections, " do not share the ",
           count, " actuators of ", data.path,
           " alike; choose another number, or write the scene by hand");
  if (count == 2) {
    const double angle = angleBetween(tips) * 180 / basics::kPi;
    muscles = angle < 105 ? 4 : 3;
    notes.push_back(basics::messageOf("the two actuators move the tip in directions ",
                                      std::round(angle), " deg apart: they are the first of ",
                                      muscles, " around the arm, of which the others stay at 0"));
  }
  arguments.take("--muscles", arm.muscles, muscles);
  arguments.take("--max-pressure-kpa", arm.max_pressure_kpa, std::ceil(1.01e-3 * highest));
  arguments.take(kTagSize, arm.tag_size, 0.0);
  arguments.take("--regulator", arm.regulator, std::string("none"));
  if (arm.extending || arm.chambers) return notes;
  const std::optional<bool> found =
      lengthens(arguments, arm, procedures::tipSeriesOf(data, arm.sections * arm.muscles));
  arm.extending = found.value_or(false);
  notes.push_back(
      found ? (arm.extending ? "the actuators lengthen under pressure, as the recording shows"
                             : "the actuators shorten under pressure, as the recording shows")
            : "the recording does not tell whether its actuators lengthen under pressure; they "
              "shorten in the scene, unless --extending or --chambers is given");
  return notes;
}

// Checks before anything is asked.
void check(NewArguments& arguments) {
  namespace fs = std::filesystem;
  const fs::path out = arguments.out;
  requireYaml(arguments.out);
  refuseIf(fs::exists(out) && !arguments.force, "--out ", arguments.out,
           " exists; choose another file, or give --force to replace it");
  refuseIf(!out.parent_path().empty() && !fs::is_directory(out.parent_path()), "--out ",
           arguments.out, " is in no folder that exists; create ", out.parent_path().string(),
           ", or choose another file");
  settleRegulator(arguments.arm);
  // A fault of this can only be the name.
  NewArguments plain;
  plain.out = arguments.out;
  plain.command = arguments.command;
  sceneOf(plain, NewArm(), false);
}

int run(const NewArguments& given, const GlobalOptions& global) {
  NewArguments arguments = given;
  refuseIf(!global.overrides.empty(),
           "--set changes a key of a scene, and new writes one; leave out --set");
  NewArm& arm = arguments.arm;
  check(arguments);
  json notes = json::array();
  if (!arguments.recording.empty()) notes = takeRecording(arguments);
  const json scene = sceneOf(arguments, arm, !arguments.defaults && isatty(STDIN_FILENO) != 0);
  if (scene.is_null()) return kInterrupted;
  const json& serial = scene["serial"];
  refuseIf(arguments.given("--device") && serial != true,
           "--device goes with a --regulator on a serial line, such as generic");
  refuseIf(arguments.given("--host") && serial != false,
           "--host goes with a --regulator on Modbus TCP, such as festo_vtem");
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
                    {"regulator", scene["regulator"]},
                    {"out", arguments.out}};
  json shown = report;
  notes.push_back(arguments.recording.empty()
                      ? "its contraction curve and stiffness are guesses: edit the file, then run "
                        "helix_arm check " +
                            arguments.out
                      : "its sizes, curve and stiffness are guesses: edit the file, then run "
                        "helix_arm calibrate " +
                            arguments.out + " " + arguments.recording +
                            " --fit stiffness,contraction,base,response --out fitted.yaml");
  shown["notes"] = notes;
  printResult(global.format, report, shown,
              Csv{{"scene", "actuators", "tags", "regulator", "out"}});
  return kDone;
}

}  // namespace

void addNew(Commands& commands) {
  auto [command, arguments] =
      commands.add<NewArguments>("new", "write a commented scene file of a new arm", run);
  arguments.command = &command;
  NewArm& arm = arguments.arm;
  addOption(command, "--out", arguments.out, "scene file to write; its stem is the scene's name",
            kRequired, TypeName{"FILE.yaml"});
  for (const Figure& figure : kFigures) {
    std::visit(
        [&](auto member) {
          addOption(command, figure.option, arm.*member, figure.help, kShowDefault);
        },
        figure.member);
  }
  addOption(
      command, "--recording", arguments.recording,
      "series of the tip, as calibrate takes it: gives the number of actuators, their highest "
      "pressure and, where it tells, whether they lengthen; the arm then has neither tags nor a "
      "regulator",
      TypeName{"FILE.csv"});
  command.add_flag("--extending", arm.extending,
                   "the muscles lengthen under pressure, as bellows do; without it they shorten");
  command.add_flag("--chambers", arm.chambers,
                   "the muscles are chambers in one body of rubber, which lengthen under pressure: "
                   "no separators between them, and a stiffer bend");
  addOption(command, "--mounting", arm.mounting,
            "where x of the arm points: hanging (-z of the world), standing (z) or lying (x)",
            CLI::IsMember({"hanging", "standing", "lying"}), kShowDefault);
  addOption(command, "--regulator", arm.regulator,
            "simulated, none, a shipped profile such as generic (the board), or the path of a "
            "profile",
            kShowDefault);
  addOption(command, "--device", arm.device, "serial device of a regulator on a serial line",
            kShowDefault);
  addOption(command, "--host", arm.host, "name or address of a regulator on Modbus TCP",
            kShowDefault);
  command.add_flag("--defaults", arguments.defaults,
                   "ask nothing; without it, a terminal is asked for what no option gives");
  command.add_flag("--force", arguments.force, "replace FILE.yaml if it exists");
  command.footer(
      R"(A webcam looks at the arm from the side. Each muscle carries a row of tags.
json: scene, actuators, tags (numbers), regulator, out. csv: one row of the same.)");
}

}  // namespace helix_arm::cli
