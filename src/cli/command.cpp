#include "command.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <sstream>

#include "basics/text.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "io/document/atomic_file.hpp"
#include "io/document/number.hpp"
#include "io/scene/shipped_files.hpp"

namespace helix_arm::cli {
namespace {

const char* const kTags = "tags";
const char* const kCharuco = "charuco";
constexpr double kUsualMarker = 0.75;  // of the side of a square

std::atomic<bool> noted{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler sets it");

statics::TierRequest requestOf(const TierArguments& arguments) {
  statics::TierRequest request;
  request.tier = statics::tierNamed(arguments.tier);
  request.order = arguments.order;
  if (arguments.accuracy_percent) request.relative_tip_error = *arguments.accuracy_percent / 100;
  if (arguments.budget_us) request.time = *arguments.budget_us * 1e-6;
  return request;
}

void checkTier(const io::Scene& scene, const TierArguments& arguments,
               const statics::TierRequest& request) {
  const bool loaded = request.tier == statics::Tier::kLoaded;
  refuseIf(request.tier == statics::Tier::kPlanar && !scene.planar,
           "--tier planar needs a scene with arm.geometry: planar; scene ", scene.name,
           " is spatial: use --tier linear");
  refuseIf(request.tier && statics::takesLoad(*request.tier) && !scene.model.load(), "--tier ",
           arguments.tier, " needs the key load in the scene; ", scene.name,
           " has none: use --tier linear");
  refuseIf(request.order && !loaded, "--order needs --tier loaded");
  refuseIf(request.relative_tip_error && request.time, "give either --accuracy or --budget");
  const char* const goal = request.relative_tip_error ? "--accuracy" : "--budget";
  refuseIf(
      (request.relative_tip_error || request.time) && request.tier && (!loaded || request.order),
      goal, " needs tiers to choose from; use --tier auto, or --tier loaded without --order");
}

// The range that scenes allow.
constexpr model::Range kTipErrorPercent{2e-7, 100};
constexpr model::Range kTimeUs{1e-3, 1e9};

void addCharucoOptions(CLI::App& command, BoardArguments& board) {
  addOption(command, "--squares", board.squares,
            "of a ChArUco board: number of squares across and down, default 7,9",
            TypeName{"ACROSS,DOWN"});
  addOption(command, "--square-size-m", board.square_size,
            "of a ChArUco board: side of a square [m], default 0.024", TypeName{"S"});
  addOption(command, "--marker-size-m", board.marker_size,
            "of a ChArUco board: side of a marker's black border [m], default three quarters of a "
            "square",
            TypeName{"S"});
  addOption(command, "--dictionary", board.dictionary,
            "of a ChArUco board: its markers, by OpenCV's name, default DICT_4X4_50",
            TypeName{"NAME"});
  command.add_flag("--legacy-pattern", board.legacy_pattern,
                   "of a ChArUco board with an even number of squares down: its top left square is "
                   "white, as OpenCV before 4.6 drew it");
}

}  // namespace

CLI::App& Commands::add(const char* name, const char* help,
                        std::function<int(const GlobalOptions&)> work) const {
  works_->push_back({app_.add_subcommand(name, help), std::move(work)});
  return *works_->back().app;
}

Commands Commands::group(const char* name, const char* help) const {
  Commands below(*app_.add_subcommand(name, help)->require_subcommand(1));
  below.works_ = works_;
  return below;
}

int Commands::run(const GlobalOptions& global) const {
  const auto parsed = std::find_if(works_->begin(), works_->end(),
                                   [](const Work& work) { return work.app->parsed(); });
  return parsed == works_->end() ? kCallerErred : parsed->run(global);
}

InterruptWatch::InterruptWatch() {
  noted = false;
  struct sigaction action {};
  action.sa_handler = [](int) { noted = true; };
  for (std::size_t i = 0; i < kSignals.size(); ++i) sigaction(kSignals[i], &action, &before_[i]);
}

InterruptWatch::~InterruptWatch() {
  for (std::size_t i = 0; i < kSignals.size(); ++i) sigaction(kSignals[i], &before_[i], nullptr);
}

bool interrupted() { return noted; }

bool Progress::reached(double done) {
  const int tenths = static_cast<int>(10 * done / total_);
  if (tenths > tenths_) {
    std::cerr << what_ << basics::format(": %.10g of %.10g%s\n", done, total_, unit_);
  }
  tenths_ = tenths;
  return !interrupted();
}

std::vector<io::Override> overridesOf(const GlobalOptions& global) {
  std::vector<io::Override> overrides;
  for (const std::string& text : global.overrides) {
    const std::size_t equals = text.find('=');
    refuseIf(equals == std::string::npos || equals == 0, "--set ", text,
             " is not key=value, as in --set arm.stiffness.K_gamma=100");
    overrides.push_back({text.substr(0, equals), text.substr(equals + 1)});
  }
  return overrides;
}

void requireYaml(const std::string& out) {
  refuseIf(!out.empty() && std::filesystem::path(out).extension() != ".yaml", "--out ", out,
           " does not end in .yaml; name a .yaml file");
}

void requireNoInput(const std::string& out, const std::vector<std::string>& inputs) {
  for (const std::string& input : inputs) {
    std::error_code ignored;  // one of them does not exist
    refuseIf(std::filesystem::equivalent(out, input, ignored), "--out ", out,
             " is an input; expected the path of another file");
  }
}

void requireWritable(const std::vector<std::string>& files) {
  for (const std::string& file : files) {
    if (file.empty()) continue;
    refuseIf(std::count(files.begin(), files.end(), file) > 1, file,
             " is given for two outputs; give each a path of its own");
    const io::AtomicFile trial(file);
  }
}

CLI::Option* addSceneOption(CLI::App& command, const std::string& option, std::string& scene,
                            const std::string& help) {
  // A name that is not known is refused when the scene is loaded, so that --help still works.
  const auto resolve = [](std::string& given) -> std::string {
    given = io::findScene(given).value_or(given);
    return {};
  };
  return addOption(command, option, scene, help + ", or name of a shipped scene")
      ->transform(CLI::Validator(resolve, ""));
}

void addScene(CLI::App& command, std::string& scene, const std::string& help) {
  addSceneOption(command, "SCENE", scene, help)->required();
}

io::Scene loadScene(const std::string& path, const GlobalOptions& global) {
  if (!io::findScene(path)) throw CallerError(io::unknownScene(path));
  return io::loadScene(path, overridesOf(global));
}

std::vector<std::string> wordsOf(const std::string& list, char comma) {
  std::vector<std::string> words;
  std::istringstream stream(list);
  for (std::string word; std::getline(stream, word, comma);) words.push_back(word);
  return words;
}

Eigen::VectorXd numberList(const std::string& option, const std::string& text, int count) {
  const std::vector<std::string> parts = wordsOf(text + ",");
  refuseIf(static_cast<int>(parts.size()) != count, option, " has ", parts.size(),
           " values; expected ", count);
  Eigen::VectorXd numbers(count);
  for (int i = 0; i < count; ++i) {
    const std::optional<double> number = io::parseNumber(parts[i]);
    refuseIf(!number, option, " has \"", parts[i], "\" as value ", i + 1,
             "; expected finite numbers separated by commas, without spaces");
    numbers[i] = *number;
  }
  return numbers;
}

void addInputOptions(CLI::App& command, InputArguments& inputs, const std::string& kpa_help,
                     const std::string& si_help) {
  addOption(command, inputs.kpa_option, inputs.kpa, kpa_help);
  if (!si_help.empty()) addOption(command, inputs.si_option, inputs.si, si_help);
}

Eigen::VectorXd inputsOf(const io::Scene& scene, const InputArguments& inputs) {
  const model::Arm& arm = scene.arm;
  const bool in_kpa = !inputs.kpa.empty();
  refuseIf(in_kpa == !inputs.si.empty(), "give either ", inputs.kpa_option, " or ",
           inputs.si_option);
  refuseIf(in_kpa && hasTendon(arm), inputs.kpa_option, " is for pressures, but scene ", scene.name,
           " has tendons; give ", inputs.si_option, " in SI units (Pa or rad) for ",
           basics::joined(arm.actuatorNames()));
  const std::string& option = in_kpa ? inputs.kpa_option : inputs.si_option;
  const std::vector<std::string> parts = wordsOf((in_kpa ? inputs.kpa : inputs.si) + ",");
  refuseIf(static_cast<int>(parts.size()) != arm.actuatorCount(), option, " has ", parts.size(),
           " values; scene ", scene.name, " has ", arm.actuatorCount(),
           " actuators: ", basics::joined(arm.actuatorNames()));
  Eigen::VectorXd out(arm.actuatorCount());
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    const model::Actuator& actuator = arm.actuator(i);
    const std::optional<double> number = io::parseNumber(parts[i]);
    if (number) out[i] = in_kpa ? io::pascals(*number) : *number;
    if (number && actuator.limits.contains(out[i])) continue;
    throw CallerError(option + " asks " + actuator.name + " for " +
                      (number ? inputText(actuator, out[i]) : '"' + parts[i] + '"') +
                      "; its limits are " + inputText(actuator, actuator.limits.lower) + " to " +
                      inputText(actuator, actuator.limits.upper));
  }
  if (!in_kpa) warnOfKilopascals(option, arm, out.transpose());
  return out;
}

Eigen::VectorXd inputsOrRest(const io::Scene& scene, const InputArguments& inputs) {
  return inputs.given() ? inputsOf(scene, inputs) : scene.arm.inputAt(0);
}

void warnOfKilopascals(const std::string& what, const model::Arm& arm,
                       const Eigen::MatrixXd& inputs) {
  const std::string warning = control::kilopascalWarning(what, arm, inputs);
  if (!warning.empty()) std::cerr << warning << "\n";
}

std::function<std::string(const std::string&)> within(const model::Range& range) {
  return [range](const std::string& text) -> std::string {
    const std::optional<double> number = io::parseNumber(text);
    if (number && range.contains(*number)) return {};
    return text + basics::format(" is not a number from %g to %g", range.lower, range.upper);
  };
}

void addTierOptions(CLI::App& command, TierArguments& arguments) {
  addOption(command, "--tier", arguments.tier,
            "how shapes are computed: auto (cheapest sufficient tier), or one of docs/loads.md; "
            "default: the scene's",
            CLI::IsMember(statics::tierWords()));
  addOption(command, "--order", arguments.order, "with --tier loaded: order of its polynomials",
            CLI::Range(statics::kLeastOrder, statics::kMostOrder));
  addOption(command, "--accuracy", arguments.accuracy_percent,
            "choose the cheapest tier with at most this tip error [% of the arm's length]",
            TypeName{"PERCENT"}, within(kTipErrorPercent));
  addOption(command, "--budget", arguments.budget_us,
            "choose the most accurate tier with at most this mean time over sampled inputs [us]",
            TypeName{"US"}, within(kTimeUs));
}

statics::ArmModel modelOf(const io::Scene& scene, const TierArguments& arguments) {
  const statics::TierRequest request = requestOf(arguments);
  if (arguments.tier.empty() && !request.order && !request.relative_tip_error && !request.time) {
    return scene.model;
  }
  checkTier(scene, arguments, request);
  try {
    return scene.model.withTier(request);
  } catch (const std::invalid_argument& error) {
    const char* const flag = request.relative_tip_error ? "--accuracy"
                             : request.time             ? "--budget"
                                                        : "--tier";
    throw CallerError(std::string(flag) + " is not possible with scene " + scene.name + ": " +
                      error.what());
  }
}

std::string inputText(const model::Actuator& actuator, double input) {
  const model::DriveUnit unit = model::unitOf(actuator.drive);
  return basics::format("%.12g %s", input / unit.scale, unit.shown);
}

bool hasTendon(const model::Arm& arm) {
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    if (!model::isPressure(arm.actuator(i).drive)) return true;
  }
  return false;
}

void addBoardOption(CLI::App& command, BoardArguments& arguments, const std::string& what) {
  addOption(command, "--board", arguments.kind, what, TypeName{"KIND"},
            CLI::IsMember({kTags, kCharuco}))
      ->default_val(kTags);
  addCharucoOptions(command, arguments);
}

void addBoardFlag(CLI::App& command, BoardArguments& arguments, const std::string& what) {
  command.add_flag("--board{tags}", arguments.kind, what)->check(CLI::IsMember({kTags, kCharuco}));
  addCharucoOptions(command, arguments);
}

std::vector<std::string> joinBoardKind(std::vector<std::string> arguments) {
  for (std::size_t i = 0; i + 1 < arguments.size(); ++i) {
    const std::string& kind = arguments[i + 1];
    if (arguments[i] != "--board" || (kind != kTags && kind != kCharuco)) continue;
    arguments[i] += "=" + kind;
    arguments.erase(arguments.begin() + static_cast<std::ptrdiff_t>(i) + 1);
  }
  return arguments;
}

void checkBoard(const BoardArguments& arguments) {
  const bool charuco = !arguments.squares.empty() || arguments.square_size ||
                       arguments.marker_size || arguments.dictionary || arguments.legacy_pattern;
  refuseIf(
      charuco && arguments.kind != kCharuco,
      "--squares, --square-size-m, --marker-size-m, --dictionary and --legacy-pattern are of a "
      "ChArUco board; add --board charuco, or leave them out");
}

CalibrationBoard boardOf(const BoardArguments& arguments) {
  checkBoard(arguments);
  if (arguments.kind != kCharuco) return vision::TagBoard();
  vision::CharucoBoard board;
  if (!arguments.squares.empty()) {
    const Eigen::Vector2d squares = numberList("--squares", arguments.squares, 2);
    refuseIf(squares != squares.array().floor().matrix() || squares.cwiseAbs().maxCoeff() > 1e6,
             "--squares is ", arguments.squares, "; expected two whole numbers: across,down");
    board.columns = static_cast<int>(squares[0]);
    board.rows = static_cast<int>(squares[1]);
  }
  if (arguments.square_size) {
    board.square_size = *arguments.square_size;
    board.marker_size = kUsualMarker * board.square_size;
  }
  board.marker_size = arguments.marker_size.value_or(board.marker_size);
  board.dictionary = arguments.dictionary.value_or(board.dictionary);
  board.legacy_pattern = arguments.legacy_pattern;
  board.validate();
  return board;
}

json boardJson(const CalibrationBoard& board) {
  if (const auto* tags = std::get_if<vision::TagBoard>(&board)) {
    return {{"family", tags->family}, {"first_id", tags->first_id}, {"columns", tags->columns},
            {"rows", tags->rows},     {"size_m", tags->tag_size},   {"pitch_m", tags->pitch}};
  }
  const auto& charuco = std::get<vision::CharucoBoard>(board);
  return {{"dictionary", charuco.dictionary},
          {"columns", charuco.columns},
          {"rows", charuco.rows},
          {"square_size_m", charuco.square_size},
          {"marker_size_m", charuco.marker_size},
          {"legacy_pattern", charuco.legacy_pattern}};
}

}  // namespace helix_arm::cli
