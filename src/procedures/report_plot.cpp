#include "helix_arm/procedures/report_plot.hpp"

#include <fstream>
#include <system_error>

#include <spawn.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include "helix_arm/io/atomic_file.hpp"

namespace helix_arm::procedures {
namespace {

namespace fs = std::filesystem;

constexpr char kReport[] = "report.json";

// Where plot_report is: beside the program where it is installed, else among the sources.
fs::path plotReport() {
  std::error_code error;
  const fs::path beside = fs::read_symlink("/proc/self/exe", error).parent_path() / "plot_report";
  return fs::exists(beside, error) ? beside : fs::path(HELIX_ARM_SCRIPTS_DIR) / "plot_report";
}

// A folder of its own for temporary files, which goes away with the object.
class Folder {
 public:
  Folder() : path_((fs::temp_directory_path() / "helix_arm_report_XXXXXX").string()) {
    if (mkdtemp(path_.data()) == nullptr) {
      throw io::FileError(path_ + " cannot be made; set TMPDIR to a folder with room");
    }
  }
  ~Folder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  fs::path operator/(const char* name) const { return fs::path(path_) / name; }

 private:
  std::string path_;
};

fs::path written(const ReportPart& part, const Folder& folder) {
  fs::path path = folder / part.name.c_str();
  std::ofstream stream(path, std::ios::binary);
  stream << part.content;
  if (!stream.flush()) {
    throw io::FileError(path.string() + " cannot be written; set TMPDIR to a folder with room");
  }
  return path;
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
  throw io::FileError(target + " could not be drawn by " + script +
                      "; install python3-matplotlib, or " + without);
}

void drawReportText(const std::string& report, const fs::path& picture, const std::string& without,
                    const ReportPart& beside) {
  const Folder folder;
  if (!beside.name.empty()) written(beside, folder);
  drawReport(written({kReport, report}, folder), picture, without);
}

}  // namespace helix_arm::procedures
