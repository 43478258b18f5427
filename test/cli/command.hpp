#pragma once

#include <string>
#include <vector>

#include "nlohmann/json.hpp"
#include "support/has.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::test {

/// What a run of the real helix_arm command left behind.
struct Outcome {
  int exit_code;
  std::string out, err;
  /// stdout as JSON. @throws when there is anything else on it.
  nlohmann::json json() const { return nlohmann::json::parse(out); }
};

/// Runs helix_arm with these arguments, as a shell would.
Outcome runCommand(const std::vector<std::string>& arguments);

/// The same with more arguments.
Outcome runCommand(std::vector<std::string> arguments, const std::vector<std::string>& more);

/// What it prints with --format json; expects this exit code.
nlohmann::json resultOf(const std::vector<std::string>& arguments, int exit_code = 0);

/// Expects exit code 2, nothing on stdout and this on stderr.
void expectCallerError(const Outcome& outcome, const std::string& message);

/// Path of a shipped scene.
std::string scenePath(const std::string& name);

/// Path of a measurement. They carry no licence and are not part of the project: tests that read
/// one are skipped where it is absent.
std::string measured(const std::string& name);

/// The doubles of a JSON array.
std::vector<double> numbersOf(const nlohmann::json& array);

/// "1,2.5,-3" with all digits, each multiplied by a factor.
std::string commaList(const std::vector<double>& numbers, double factor = 1.0);

/// A CSV as rows of cells; `#` lines are left out.
std::vector<std::vector<std::string>> csvRows(const std::string& text);

}  // namespace helix_arm::test
