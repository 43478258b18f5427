#include "plot.hpp"

#include <fstream>

#include <spawn.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include "command.hpp"
#include "helix_arm/io/atomic_file.hpp"

namespace helix_arm::cli {
namespace {

namespace fs = std::filesystem;

// plot_report is next to the command if installed, otherwise in the sources.
fs::path plotReport() {
  std::error_code error;
  const fs::path beside = fs::read_symlink("/proc/self/exe", error).parent_path() / "plot_report";
  return fs::exists(beside, error) ? beside : fs::path(HELIX_ARM_SCRIPTS_DIR) / "plot_report";
}

// A temporary file for plot_report, removed by the destructor.
class ReportFile {
 public:
  explicit ReportFile(const nlohmann::json& report)
      : path_((fs::temp_directory_path() / "helix_arm_report_XXXXXX").string()) {
    const int file = mkstemp(path_.data());
    if (file < 0)
      throw CallerError(path_ + " cannot be created; set TMPDIR to a folder with free space");
    close(file);
    std::ofstream stream(path_);
    stream << report;
    if (!stream.flush()) {
      fs::remove(path_);
      throw CallerError(path_ + " cannot be written; set TMPDIR to a folder with free space");
    }
  }
  ~ReportFile() {
    std::error_code ignored;
    fs::remove(path_, ignored);
  }
  ReportFile(const ReportFile&) = delete;
  ReportFile& operator=(const ReportFile&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

// Whether both paths name the same file, existing or not.
bool samePlace(const std::string& one, const std::string& other) {
  std::error_code error;
  if (fs::equivalent(one, other, error)) return true;
  return fs::weakly_canonical(fs::absolute(one)) == fs::weakly_canonical(fs::absolute(other));
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

void drawJsonReport(const nlohmann::json& report, const std::string& picture,
                    const std::string& without) {
  const ReportFile file(report);
  drawReport(file.path(), picture, without);
}

void checkPicture(const std::string& png, const std::string& out) {
  if (png.empty()) return;
  if (!out.empty() && samePlace(out, png)) {
    throw CallerError("--png " + png + " is the file of --out, too; give another path");
  }
  const io::AtomicFile trial(png);  // throws if none can be written there; leaves no file
}

}  // namespace helix_arm::cli
