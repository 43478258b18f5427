#include "plot.hpp"

#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include "command.hpp"

namespace helix_arm::cli {
namespace {

namespace fs = std::filesystem;

// Where plot_report is: beside the command where it is installed, else among the sources.
fs::path plotReport() {
  std::error_code error;
  const fs::path beside = fs::read_symlink("/proc/self/exe", error).parent_path() / "plot_report";
  return fs::exists(beside, error) ? beside : fs::path(HELIX_ARM_SCRIPTS_DIR) / "plot_report";
}

}  // namespace

void drawReport(const fs::path& report, const fs::path& picture, const std::string& without) {
  const std::string script = plotReport(), source = report, target = picture;
  char* const arguments[] = {const_cast<char*>(script.c_str()), const_cast<char*>(source.c_str()),
                             const_cast<char*>(target.c_str()), nullptr};
  pid_t child = 0;
  int status = 0;
  const int failed = posix_spawn(&child, script.c_str(), nullptr, nullptr, arguments, environ);
  if (failed == 0) waitpid(child, &status, 0);
  if (failed == 0 && WIFEXITED(status) && WEXITSTATUS(status) == 0) return;
  throw CallerError(target + " could not be drawn by " + script +
                    "; install python3-matplotlib, or " + without);
}

}  // namespace helix_arm::cli
