#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

#include "command.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/vision/charuco_board.hpp"
#include "nlohmann/json.hpp"

namespace helix_arm::cli {

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

/// Adds an option for a scene: a file, or the name of a shipped scene.
CLI::Option* addScene(CLI::App& command, const std::string& option, std::string& scene,
                      const std::string& what);

/// Loads a scene with the overrides of --set.
/// @throws CallerError on an override that is not key=value, io::DocumentError on a scene with
/// faults.
io::Scene loadScene(const std::string& path, const GlobalOptions& global);

/// @throws CallerError unless the name of a scene to write ends in .yaml.
void requireYaml(const std::string& out);
/// @throws CallerError if the file of --out is that of an input. Either may not exist.
void requireNoInput(const std::string& out, const std::string& input);

/// The overrides of --set.
/// @throws CallerError on one that is not key=value.
std::vector<io::Override> overridesOf(const GlobalOptions& global);

/// The parts of a list: "a", "" and "b" of "a,,b"; none behind a comma at the end.
std::vector<std::string> wordsOf(const std::string& list, char comma = ',');

/// The numbers of a comma list such as "-0.1,0.2".
/// @throws CallerError naming the option and the entry that is no finite number, or a wrong count.
Eigen::VectorXd numberList(const std::string& option, const std::string& text, int count);

/// A check of an option: from its text a message, empty for a number within the range.
std::function<std::string(const std::string&)> within(const model::Range& range);

/// Inputs of all actuators [Pa or rad] from the text of a kPa option or else of one in SI units;
/// exactly one is given.
/// @throws CallerError naming the option, or the actuator, its value and its limit.
Eigen::VectorXd inputsOf(const io::Scene& scene, const std::string& kpa_option,
                         const std::string& kpa_text, const std::string& si_option,
                         const std::string& si_text);

/// The same of --pressure-kpa or --input; at rest if neither is given.
Eigen::VectorXd inputsOrRest(const io::Scene& scene, const std::string& kpa_text,
                             const std::string& si_text);

/// Warns on stderr of inputs in SI units (rows x n) whose pressures seem to be in kPa.
void warnOfKilopascals(const std::string& what, const model::Arm& arm,
                       const Eigen::MatrixXd& inputs);

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

std::vector<std::string> actuatorNames(const model::Arm& arm);

/// An input with its unit: "413.6856 kPa" or "1.5 rad".
std::string inputText(const model::Actuator& actuator, double input);

/// True when some actuator of the arm is a tendon, so that inputs are not all pressures.
bool hasTendon(const model::Arm& arm);

// The calibration board on the command line: a board of tags, or a ChArUco board.

using CalibrationBoard = std::variant<vision::TagBoard, vision::CharucoBoard>;

struct BoardArguments {
  std::string kind;  ///< empty: no board is asked for
  std::string squares;
  vision::CharucoBoard charuco;
  std::vector<CLI::Option*> of_charuco;  ///< options that a ChArUco board alone has

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
nlohmann::json boardJson(const CalibrationBoard& board);

}  // namespace helix_arm::cli
