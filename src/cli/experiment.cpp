#include <cerrno>
#include <cstring>
#include <filesystem>

#include <unistd.h>

#include "command.hpp"

namespace helix_arm::cli {

// Continues as the program of the Python package, which reads the words and has the help.
Subcommand addExperiment(CLI::App& app) {
  CLI::App* command = app.add_subcommand(
      "experiment", "measure an arm by a fixed protocol: figures with standard errors, data sheet");
  command->set_help_flag();
  command->fallthrough(false)->prefix_command();
  return {command, [command](const GlobalOptions& global) -> int {
            const char* const formats[] = {"text", "json", "csv"};
            const auto program =
                std::filesystem::read_symlink("/proc/self/exe").parent_path() / "experiments";
            std::vector<std::string> words = command->remaining();
            words.insert(words.begin(),
                         {program.string(), "--format", formats[static_cast<int>(global.format)]});
            for (const std::string& one : global.overrides) words.push_back("--set=" + one);
            std::vector<char*> arguments;
            for (std::string& word : words) arguments.push_back(word.data());
            arguments.push_back(nullptr);
            ::execv(arguments[0], arguments.data());
            throw CallerError(program.string() + " cannot be run: " + std::strerror(errno) +
                              "; check that the package is completely installed");
          }};
}

}  // namespace helix_arm::cli
