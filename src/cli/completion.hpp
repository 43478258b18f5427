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

/// What may stand for a value, besides the words that a check names.
enum class Offer {
  kWords,    ///< these words, which the option checks by itself
  kList,     ///< a comma list of these words
  kScene,    ///< the name of a shipped scene, or a file
  kProfile,  ///< the name of a shipped regulator profile, or one of these words
};

/// Has an option completed so.
void offer(CLI::Option* option, Offer kind, const std::vector<std::string>& words = {});

}  // namespace helix_arm::cli
