#include <algorithm>
#include <exception>
#include <iostream>
#include <map>
#include <optional>

#include "arguments.hpp"
#include "command.hpp"
#include "completion.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "output.hpp"

namespace {

using helix_arm::cli::Format;
using helix_arm::cli::GlobalOptions;
using helix_arm::cli::Subcommand;

const char* const kFooter =
    "Units: pressures are gauge; kPa where an option says so, otherwise SI. Poses and twists\n"
    "are seen from the arm's base, x along the arm. A twist is [vx,vy,vz,wx,wy,wz] in m and\n"
    "rad over a whole section.\n"
    "json and csv stand alone on stdout, with all digits; messages go to stderr.\n"
    "Exit codes: 0 done; 1 the data did not allow it (the reason is in the result); 2 the\n"
    "call or a document is wrong (the reason is on stderr).";

// Those that may follow what was parsed, on stderr; nothing where none may.
void tellSubcommands(const CLI::App& app) {
  const CLI::App* last = &app;
  while (!last->get_subcommands().empty()) last = last->get_subcommands().front();
  std::string names;
  for (const CLI::App* each : last->get_subcommands([](const CLI::App*) { return true; })) {
    names += (names.empty() ? "" : ", ") + each->get_name();
  }
  if (names.empty()) return;
  std::cerr << (last == &app ? "commands" : "subcommands of " + last->get_name()) << ": " << names
            << "\n";
}

// Messages repeat arguments, also on stdout, where none may pass for a line of its own. The value
// of --set is YAML, which may have several lines.
void checkArguments(const std::vector<std::string>& arguments) {
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    const std::string& argument = arguments[i];
    if (argument.rfind("--set=", 0) == 0 || (i > 0 && arguments[i - 1] == "--set")) continue;
    const bool sound = std::none_of(argument.begin(), argument.end(),
                                    [](char c) { return (c >= 0 && c < ' ') || c == '\x7f'; });
    if (sound) continue;
    throw helix_arm::cli::CallerError("argument " + std::to_string(i + 1) + " is " + argument +
                                      "; expected one without control characters");
  }
}

int run(int argc, char** argv) {
  CLI::App app("Kinematics of pneumatic arms, with or without load: pressures to shape and back.",
               "helix_arm");
  app.footer(kFooter);
  app.set_version_flag("--version", "helix_arm " HELIX_ARM_VERSION);
  app.require_subcommand(1);
  app.fallthrough();  // global options may follow the subcommand
  app.failure_message([](const CLI::App* failed, const CLI::Error& error) {
    const std::string line = helix_arm::basics::printable(error.what());
    return CLI::FailureMessage::simple(failed, CLI::Error(error.get_name(), line));
  });

  GlobalOptions global;
  const std::map<std::string, Format> formats{
      {"text", Format::kText}, {"json", Format::kJson}, {"csv", Format::kCsv}};
  std::string format = "text";
  addOption(app, "--format", format, "output format: text, json or csv",
            CLI::IsMember({"text", "json", "csv"}), kShowDefault);
  addOption(app, "--set", global.overrides,
            "override a key of the scene, list entries by number from 0; repeatable",
            TypeName{"KEY=VALUE"})
      ->allow_extra_args(false);

  const Subcommand subcommands[] = {
      helix_arm::cli::addForward(app),   helix_arm::cli::addInverse(app),
      helix_arm::cli::addEvaluate(app),  helix_arm::cli::addFit(app),
      helix_arm::cli::addCalibrate(app), helix_arm::cli::addLocalize(app),
      helix_arm::cli::addSimulate(app),  helix_arm::cli::addTrade(app),
      helix_arm::cli::addWorkspace(app), helix_arm::cli::addPath(app),
      helix_arm::cli::addFollow(app),    helix_arm::cli::addTags(app),
      helix_arm::cli::addCamera(app),    helix_arm::cli::addCheck(app),
      helix_arm::cli::addNew(app),       helix_arm::cli::addRegulator(app)};
  if (argc > 1 && std::string(argv[1]) == helix_arm::cli::kCompleteOption) {
    helix_arm::cli::printCompletions(app, {argv + 2, argv + argc}, std::cout);
    return helix_arm::cli::kDone;
  }
  try {
    std::vector<std::string> arguments(argv + 1, argv + argc);
    checkArguments(arguments);
    arguments = helix_arm::cli::joinBoardKind(std::move(arguments));
    std::reverse(arguments.begin(), arguments.end());  // as CLI11 takes them
    app.parse(std::move(arguments));
  } catch (const CLI::ParseError& error) {
    const bool unknown_command = app.get_subcommands().empty() && !app.remaining().empty();
    if (unknown_command) {
      std::cerr << "there is no command " << app.remaining().front() << ": ";
    }
    if (app.exit(error) == 0) return helix_arm::cli::kDone;  // --help and --version
    tellSubcommands(app);
    return helix_arm::cli::kCallerErred;
  }
  global.format = formats.at(format);
  std::optional<helix_arm::cli::PrintableStream> for_people;
  if (global.format == Format::kText) for_people.emplace(std::cout);
  int exit_code = helix_arm::cli::kCallerErred;
  for (const Subcommand& subcommand : subcommands) {
    if (subcommand.app->parsed()) exit_code = subcommand.run(global);
  }
  if (!std::cout.flush()) throw helix_arm::cli::CallerError("stdout cannot be written to");
  return exit_code;
}

}  // namespace

int main(int argc, char** argv) {
  const helix_arm::cli::PrintableStream printable(std::cerr);
  try {
    return run(argc, argv);
  } catch (const helix_arm::io::DocumentError& faults) {  // a line each
    std::cerr << faults.what() << '\n';
  } catch (const std::exception& error) {
    std::cerr << helix_arm::basics::printable(error.what()) << '\n';
  }
  return helix_arm::cli::kCallerErred;
}
