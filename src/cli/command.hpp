#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

#include <signal.h>

#include "CLI/CLI.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/scene.hpp"
#include "output.hpp"
#include "vision/charuco_board.hpp"

// A command: its options, and the scene, inputs, model and board that these ask for.

namespace helix_arm::cli {

/// Exit codes: done; the data did not allow it (the reason is in the result); the caller erred (the
/// reason on stderr); interrupted, as a shell gives it for Ctrl-C.
inline constexpr int kDone = 0, kNotPossible = 1, kCallerErred = 2, kInterrupted = 130;

/// A request that cannot be carried out as it stands; what() says why and how to mend it.
class CallerError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};
/// @throws CallerError with the concatenated message parts if `wrong`.
template <class... Parts>
void refuseIf(bool wrong, const Parts&... message) {
  if (wrong) throw CallerError(basics::messageOf(message...));
}

/// Options of every command.
struct GlobalOptions {
  Format format = Format::kText;
  std::string format_word = "text";    ///< as --format says it
  std::vector<std::string> overrides;  ///< key=value
  std::string session;                 ///< folder that keeps the run; empty: none
};

/// The commands of an application, or those below one of its commands.
class Commands {
 public:
  /// A command to which options are added, and the struct that keeps them.
  template <class Options>
  struct Added {
    CLI::App& command;
    Options& options;
  };

  explicit Commands(CLI::App& app) : app_(app), works_(std::make_shared<std::vector<Work>>()) {}
  /// Adds a command.
  /// @param work  gives an exit code.
  CLI::App& add(const char* name, const char* help,
                std::function<int(const GlobalOptions&)> work) const;
  /// @param options  those that it shares with others; default: its own.
  template <class Options>
  Added<Options> add(const char* name, const char* help,
                     int (*work)(const Options&, const GlobalOptions&),
                     const std::shared_ptr<Options>& options = std::make_shared<Options>()) {
    CLI::App& command = add(name, help, [options, work](const GlobalOptions& global) {
      return work(*options, global);
    });
    return {command, *options};
  }
  /// Adds a command that needs one of those below it.
  Commands group(const char* name, const char* help) const;
  CLI::App& app() const { return app_; }
  /// Does the command that was parsed. @return the exit code.
  int run(const GlobalOptions& global) const;

 private:
  struct Work {
    CLI::App* app;
    std::function<int(const GlobalOptions&)> run;
  };

  CLI::App& app_;
  std::shared_ptr<std::vector<Work>> works_;  // of all groups
};

void addAttain(Commands& commands);
void addCalibrate(Commands& commands);
void addCamera(Commands& commands);
void addCheck(Commands& commands);
void addCommission(Commands& commands);
void addDoctor(Commands& commands);
void addEvaluate(Commands& commands);
void addExperiment(Commands& commands);
void addFit(Commands& commands);
void addFollow(Commands& commands);
void addForward(Commands& commands);
void addInverse(Commands& commands);
void addLocalize(Commands& commands);
void addMotion(Commands& commands);
void addNew(Commands& commands);
void addPath(Commands& commands);
void addPayload(Commands& commands);
void addPlan(Commands& commands);
void addRegulator(Commands& commands);
void addSession(Commands& commands);
void addSimulate(Commands& commands);
void addTags(Commands& commands);
void addTrade(Commands& commands);
void addWorkspace(Commands& commands);

/// Runs scripts/NAME.py in the place of this process.
/// @param words  its arguments behind the path of this program.
/// @throws CallerError where it cannot be run; otherwise it does not return.
int runPython(const std::string& script, std::vector<std::string> words);

/// While it lives, Ctrl-C and the like are noted instead of ending the process.
class InterruptWatch {
 public:
  InterruptWatch();
  ~InterruptWatch();
  InterruptWatch(const InterruptWatch&) = delete;
  InterruptWatch& operator=(const InterruptWatch&) = delete;

 private:
  static constexpr std::array<int, 3> kSignals{SIGINT, SIGTERM, SIGHUP};
  std::array<struct sigaction, kSignals.size()> before_{};
};

/// Whether one was noted since the last watch began.
bool interrupted();

/// Tells on stderr, at every tenth, how much of a long work is done.
class Progress {
 public:
  /// "what: 2 of 20 unit"
  Progress(std::string what, double total, const char* unit)
      : what_(std::move(what)), total_(total), unit_(unit) {}
  /// @return false once interrupted.
  bool reached(double done);

 private:
  const std::string what_;
  const double total_;
  const char* const unit_;
  int tenths_ = 0;
};

// Options.

/// Rules of addOption() besides checks.
enum class OptionRule { kRequired, kShowDefault };
inline constexpr OptionRule kRequired = OptionRule::kRequired;
inline constexpr OptionRule kShowDefault = OptionRule::kShowDefault;
/// The name of an option's values in the help.
struct TypeName {
  const char* text;
};

/// Adds an option with rules: kRequired, kShowDefault, a TypeName, or a check as CLI11 takes it.
template <class Value, class... Rules>
CLI::Option* addOption(CLI::App& command, const std::string& name, Value& value,
                       const std::string& help, const Rules&... rules) {
  CLI::Option* const option = command.add_option(name, value, help);
  [[maybe_unused]] const auto apply = [option](const auto& rule) {
    using Rule = std::decay_t<decltype(rule)>;
    if constexpr (std::is_same_v<Rule, TypeName>) {
      option->type_name(rule.text);
    } else if constexpr (!std::is_same_v<Rule, OptionRule>) {
      option->check(rule);
    } else if (rule == kRequired) {
      option->required();
    } else {
      option->capture_default_str();
    }
  };
  (apply(rules), ...);
  return option;
}

/// A check of an option: from its text a message, empty for a number within the range.
std::function<std::string(const std::string&)> within(const model::Range& range);

/// The parts of a list: "a", "" and "b" of "a,,b"; none behind a comma at the end.
std::vector<std::string> wordsOf(const std::string& list, char comma = ',');

/// The numbers of a comma list such as "-0.1,0.2".
/// @throws CallerError naming the option and the entry that is no finite number, or a wrong count.
Eigen::VectorXd numberList(const std::string& option, const std::string& text, int count);

// Files to write, before work that takes long. Names may be empty, which means none.

/// @throws CallerError unless the name of a scene to write ends in .yaml.
void requireYaml(const std::string& out);
/// @throws CallerError if the file of --out is that of an input. Any may not exist.
void requireNoInput(const std::string& out, const std::vector<std::string>& inputs);
/// @throws io::FileError if one of them cannot be written. Leaves no file.
void requireWritable(const std::vector<std::string>& files);

// The scene.

/// Adds an option for a scene: a file, or the name of a shipped scene.
CLI::Option* addSceneOption(CLI::App& command, const std::string& option, std::string& scene,
                            const std::string& help);
/// Adds SCENE, which is required.
void addScene(CLI::App& command, std::string& scene, const std::string& help = "scene file");

/// Loads a scene with the overrides of --set.
/// @throws CallerError on an override that is not key=value, io::DocumentError on a scene with
/// faults.
io::Scene loadScene(const std::string& path, const GlobalOptions& global);

/// The overrides of --set.
/// @throws CallerError on one that is not key=value.
std::vector<io::Override> overridesOf(const GlobalOptions& global);

/// True when some actuator of the arm is a tendon, so that inputs are not all pressures.
bool hasTendon(const model::Arm& arm);

// Inputs of all actuators.

/// Two options, of which one is given: in kPa, or in SI units.
struct InputArguments {
  std::string kpa_option = "--pressure-kpa", si_option = "--input";
  std::string kpa = {}, si = {};  ///< their texts; empty where they are not given

  bool given() const { return !kpa.empty() || !si.empty(); }
};

/// Adds both, or without a help for SI units the first alone.
void addInputOptions(CLI::App& command, InputArguments& inputs, const std::string& kpa_help,
                     const std::string& si_help = "");

/// Inputs [Pa or rad].
/// @throws CallerError naming the option, or the actuator, its value and its limit.
Eigen::VectorXd inputsOf(const io::Scene& scene, const InputArguments& inputs);
/// The same; at rest if none are given.
Eigen::VectorXd inputsOrRest(const io::Scene& scene, const InputArguments& inputs);

/// An input with its unit: "413.6856 kPa" or "1.5 rad".
std::string inputText(const model::Actuator& actuator, double input);

/// Warns on stderr of inputs in SI units (rows x n) whose pressures seem to be in kPa.
void warnOfKilopascals(const std::string& what, const model::Arm& arm,
                       const Eigen::MatrixXd& inputs);

// The model.

/// The tier that the command line asks for, in place of all that the scene asks for.
struct TierArguments {
  std::string tier;                        ///< empty: the scene's
  std::optional<int> order;                ///< of the loaded tier
  std::optional<double> accuracy_percent;  ///< of the arm's length
  std::optional<double> budget_us;
};

/// Adds --tier, --order, --accuracy and --budget.
void addTierOptions(CLI::App& command, TierArguments& arguments);

/// The scene's model, or where the options ask for something, the same arm and load that way.
/// @throws CallerError naming the option, what it meets in the scene and the remedy.
statics::ArmModel modelOf(const io::Scene& scene, const TierArguments& arguments);

// The calibration board: a board of tags, or a ChArUco board.

using CalibrationBoard = std::variant<vision::TagBoard, vision::CharucoBoard>;

struct BoardArguments {
  std::string kind;     ///< empty: no board is asked for
  std::string squares;  ///< this and the others are of a ChArUco board
  std::optional<double> square_size, marker_size;
  std::optional<std::string> dictionary;
  bool legacy_pattern = false;

  bool given() const { return !kind.empty(); }
};

/// Adds --board KIND, which is tags unless given, and the options of a ChArUco board.
void addBoardOption(CLI::App& command, BoardArguments& arguments, const std::string& what);
/// Adds --board, which alone means tags, and the options of a ChArUco board.
void addBoardFlag(CLI::App& command, BoardArguments& arguments, const std::string& what);

/// The arguments of a call with a kind that follows --board as part of it, as a flag takes it.
std::vector<std::string> joinBoardKind(std::vector<std::string> arguments);

/// @throws CallerError on options of a ChArUco board without one.
void checkBoard(const BoardArguments& arguments);
/// @throws CallerError as checkBoard(), and naming the option that breaks a rule.
CalibrationBoard boardOf(const BoardArguments& arguments);

/// `board` of the reports: keys of either kind.
json boardJson(const CalibrationBoard& board);

}  // namespace helix_arm::cli
