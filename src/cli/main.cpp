#include <algorithm>
#include <iostream>
#include <map>

#include "basics/quote.hpp"
#include "command.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "io/scene/shipped_files.hpp"

namespace helix_arm::cli {
namespace {

const char* const kFooter =
    "Units: pressures are gauge; kPa where an option says so, otherwise SI. Poses and twists\n"
    "are seen from the arm's base, x along the arm. A twist is [vx,vy,vz,wx,wy,wz] in m and\n"
    "rad over a whole section.\n"
    "Derivatives (the Jacobian of tip and shape): in Python, helix_arm.Scene.jacobian().\n"
    "json and csv stand alone on stdout, with all digits; messages go to stderr.\n"
    "Exit codes: 0 done; 1 the data did not allow it (the reason is in the result); 2 the\n"
    "call or a document is wrong (the reason is on stderr).";

// Asks, in place of work, for names that the help does not list: scripts/completion.py
// offers them.
const std::string kNamesOption = "--names";

// @param what  "dictionaries" of a ChArUco board, or a folder of shipped files.
void printNames(const std::string& what) {
  if (what == "dictionaries") {
    for (const auto& known : vision::markerDictionaries()) std::cout << known.name << "\n";
  } else {
    for (const std::string& name : io::shippedNames(what)) std::cout << name << "\n";
  }
}

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

// Contents of --session: the same call gives the same result.
const std::string kKept =
    "calibrate, commission, evaluate, experiment, fit, follow, localize, simulate";

// Has the call run without --session, and kept. @throws CallerError where it is of no such kind.
int keepSession(const std::string& name, std::string folder, std::vector<std::string> words) {
  refuseIf((kKept + ",").find(name + ",") == std::string::npos, "--session does not keep ", name,
           "; it keeps ", kKept);
  words.insert(words.begin(), {"keep", folder, name, io::shippedFolder(io::kShippedScenes)});
  return runPython("session", std::move(words));
}

// The exit code where the call ends here: --help, --version and errors.
std::optional<int> parse(CLI::App& app, std::vector<std::string> arguments) {
  arguments = joinBoardKind(std::move(arguments));
  std::reverse(arguments.begin(), arguments.end());  // as CLI11 takes them
  try {
    app.parse(std::move(arguments));
    return std::nullopt;
  } catch (const CLI::ParseError& error) {
    if (app.get_subcommands().empty() && !app.remaining().empty()) {
      std::cerr << "there is no command " << app.remaining().front() << ": ";
    }
    if (app.exit(error) == 0) return kDone;  // --help and --version
    tellSubcommands(app);
    return kCallerErred;
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
    const std::string line = basics::printable(error.what());
    return CLI::FailureMessage::simple(failed, CLI::Error(error.get_name(), line));
  });

  GlobalOptions global;
  const std::map<std::string, Format> formats{
      {"text", Format::kText}, {"json", Format::kJson}, {"csv", Format::kCsv}};
  addOption(app, "--format", global.format_word, "output format: text, json or csv",
            CLI::IsMember({"text", "json", "csv"}), kShowDefault);
  addOption(app, "--set", global.overrides,
            "override a key of the scene, list entries by number from 0; repeatable",
            TypeName{"KEY=VALUE"})
      ->allow_extra_args(false);
  addOption(app, "--session", global.session,
            "folder that keeps this run in a folder of its own; of " + kKept, TypeName{"DIR"});

  Commands commands(app);
  for (const auto add :
       {addForward,    addInverse,  addPayload,  addAttain,    addEvaluate,  addFit,
        addCalibrate,  addLocalize, addSimulate, addTrade,     addWorkspace, addMotion,
        addPlan,       addPath,     addFollow,   addTags,      addCamera,    addCommission,
        addExperiment, addCheck,    addNew,      addRegulator, addSession,   addDoctor}) {
    add(commands);
  }
  if (argc == 3 && argv[1] == kNamesOption) {
    printNames(argv[2]);
    return kDone;
  }
  if (const auto exit_code = parse(app, {argv + 1, argv + argc})) return *exit_code;
  global.format = formats.at(global.format_word);
  if (!global.session.empty()) {
    return keepSession(app.get_subcommands()[0]->get_name(), global.session,
                       {argv + 1, argv + argc});
  }
  const int exit_code = commands.run(global);
  if (!std::cout.flush()) throw CallerError("stdout cannot be written to");
  return exit_code;
}

}  // namespace

}  // namespace helix_arm::cli

int main(int argc, char** argv) {
  try {
    return helix_arm::cli::run(argc, argv);
  } catch (const helix_arm::io::DocumentError& faults) {  // a line each
    std::cerr << helix_arm::basics::printableLines(faults.what()) << '\n';
  } catch (const std::exception& error) {
    std::cerr << helix_arm::basics::printable(error.what()) << '\n';
  }
  return helix_arm::cli::kCallerErred;
}
