#include <algorithm>
#include <filesystem>

#include <unistd.h>

#include "command.hpp"
#include "io/scene/shipped_files.hpp"
#include "procedures/report_plot.hpp"

namespace helix_arm::cli {

int runPython(const std::string& script, std::vector<std::string> words) {
  const auto program = std::filesystem::read_symlink("/proc/self/exe");
  const auto file = procedures::scriptPath(script + ".py");
  words.insert(words.begin(), {"/usr/bin/python3", file, program});
  std::vector<char*> arguments(words.size() + 1);
  std::transform(words.begin(), words.end(), arguments.begin(),
                 [](std::string& word) { return word.data(); });
  if (std::filesystem::exists(file)) execv(arguments[0], arguments.data());
  throw CallerError(file.string() +
                    " cannot be run; check that the package is completely installed");
}

void addDoctor(Commands& commands) {
  const auto run = [](const auto& global) { return runPython("doctor", {global.format_word}); };
  commands.add("doctor", "does this computer have what an arm needs?", run)
      .footer(
          R"(Nothing moves. helix_arm check does the same for a scene and its rig.
json: checks [{name, state (ok, warning, fault, not_checked), found, remedy}].
csv: one row per check. Exit code 1 if there is a fault.)");
}

// scripts/experiment.py reads the words and has the help.
void addExperiment(Commands& commands) {
  const char* const kName = "experiment";
  CLI::App& app = commands.app();
  const auto run = [&app, kName](const GlobalOptions& global) {
    std::vector<std::string> words{"--format", global.format_word};
    for (const std::string& one : global.overrides) words.push_back("--set=" + one);
    const std::vector<std::string> rest = app.get_subcommand(kName)->remaining();
    words.insert(words.end(), rest.begin(), rest.end());
    return runPython(kName, words);
  };
  CLI::App& command = commands.add(
      kName, "measure an arm by a fixed protocol: figures with standard errors, data sheet", run);
  command.set_help_flag();
  command.fallthrough(false)->prefix_command();
}

void addSession(Commands& commands) {
  const auto folder = std::make_shared<std::string>(), out = std::make_shared<std::string>();
  const auto run = [folder, out](const GlobalOptions& global) {
    const std::string scenes = io::shippedFolder(io::kShippedScenes);
    return runPython("session", {"rerun", global.format_word, *folder, *out, scenes});
  };
  CLI::App& rerun = commands.group("session", "make a run that --session kept again")
                        .add("rerun", "run it again, and compare what it gives", run);
  addOption(rerun, "FOLDER", *folder, "folder of the run, below that of --session", kRequired);
  addOption(rerun, "--out", *out, "folder for what it gives; must be empty or absent",
            TypeName{"DIR"});
  rerun.footer(
      R"(The same command runs on the copies of its scenes and data, in a folder of its own.
json: folder, same (true or false), version, version_then, exit_code, exit_code_then,
differences [{file (stdout.txt, or of the run), line, then, now}], out. csv: one row per
difference. Exit code 1 unless all is the same.)");
}

}  // namespace helix_arm::cli
