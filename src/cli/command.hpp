#pragma once

#include <array>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include <signal.h>

#include "CLI/CLI.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::cli {

/// Exit codes: done; the data did not allow it (the reason is in the result); the caller erred (the
/// reason on stderr).
inline constexpr int kDone = 0;
inline constexpr int kNotPossible = 1;
inline constexpr int kCallerErred = 2;

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

enum class Format { kText, kJson, kCsv };

/// Options of every subcommand.
struct GlobalOptions {
  Format format = Format::kText;
  std::string format_word = "text";    ///< as --format says it
  std::vector<std::string> overrides;  ///< key=value
  std::string session;                 ///< folder that keeps the run; empty: none
};

/// A subcommand: what parses its options, and its work, which gives an exit code.
struct Subcommand {
  CLI::App* app;
  std::function<int(const GlobalOptions&)> run;
};

Subcommand addAttain(CLI::App& app);
Subcommand addForward(CLI::App& app);
Subcommand addInverse(CLI::App& app);
Subcommand addCheck(CLI::App& app);
Subcommand addDoctor(CLI::App& app);
Subcommand addEvaluate(CLI::App& app);
Subcommand addExperiment(CLI::App& app);
Subcommand addFit(CLI::App& app);
Subcommand addCalibrate(CLI::App& app);
Subcommand addCamera(CLI::App& app);
Subcommand addCommission(CLI::App& app);
Subcommand addFollow(CLI::App& app);
Subcommand addLocalize(CLI::App& app);
Subcommand addMotion(CLI::App& app);
Subcommand addPlan(CLI::App& app);
Subcommand addNew(CLI::App& app);
Subcommand addPath(CLI::App& app);
Subcommand addPayload(CLI::App& app);
Subcommand addRegulator(CLI::App& app);
Subcommand addSession(CLI::App& app);
Subcommand addSimulate(CLI::App& app);
Subcommand addTags(CLI::App& app);
Subcommand addTrade(CLI::App& app);
Subcommand addWorkspace(CLI::App& app);

/// Runs scripts/NAME.py in the place of this process.
/// @param words  its arguments behind the path of this program.
/// @throws CallerError where it cannot be run; otherwise it does not return.
int runPython(const std::string& script, std::vector<std::string> words);

/// Exit code of a command that was interrupted, as a shell gives it for Ctrl-C.
inline constexpr int kInterrupted = 130;

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

}  // namespace helix_arm::cli
