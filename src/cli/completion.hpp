#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "CLI/CLI.hpp"

namespace helix_arm::cli {

/// First argument that asks for completions in place of work; cmake/env_hooks/50.helix_arm.bash
/// gives it.
inline constexpr char kCompleteOption[] = "--complete";

/// Prints what may stand in the place of the last word, as `app` would parse the words.
///
/// The first line is the pattern of files that may stand there too: `*`, `*.yaml`, or empty for
/// none. Then one completion per line.
/// @param words  after the name of the program, as bash splits them: `=` is a word of its own. The
/// last one is to be completed; it may be empty.
void printCompletions(CLI::App& app, std::vector<std::string> words, std::ostream& out);

/// Names the words that an option takes and checks by itself, so that they are completed.
void offerWords(CLI::Option* option, const std::vector<std::string>& words);
/// The same of an option that takes a comma list of them.
void offerList(CLI::Option* option, const std::vector<std::string>& words);
/// The same of an option that takes the name of a shipped scene, or a file.
void offerScenes(CLI::Option* option);
/// The same of an option that takes the name of a shipped regulator profile, or another word.
void offerProfiles(CLI::Option* option, const std::vector<std::string>& besides);

}  // namespace helix_arm::cli
