#include "helix_arm/procedures/report_plot.hpp"

#include <fstream>
#include <iterator>
#include <stdexcept>
#include <system_error>

#include <fcntl.h>
#include <spawn.h>
#include <stdlib.h>
#include <sys/stat.h>
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

std::string contentOf(const fs::path& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

// @param printed  file for what plot_report prints on stdout; empty: none.
void run(const fs::path& report, const fs::path& picture, const std::string& without,
         const fs::path& printed) {
  constexpr int kRefused = 3;  // exit code; it prints why
  const std::string script = plotReport(), source = report, target = picture;
  char* const arguments[] = {const_cast<char*>(script.c_str()), const_cast<char*>(source.c_str()),
                             const_cast<char*>(target.c_str()), nullptr};
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  if (!printed.empty()) {
    posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, printed.c_str(), O_WRONLY | O_CREAT,
                                     S_IRUSR | S_IWUSR);
  }
  pid_t child = 0;
  int status = 0;
  const int failed = posix_spawn(&child, script.c_str(), &actions, nullptr, arguments, environ);
  posix_spawn_file_actions_destroy(&actions);
  if (failed == 0) waitpid(child, &status, 0);
  const int exit_code = failed == 0 && WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  if (exit_code == 0) return;
  if (exit_code == kRefused) {
    const std::string why = contentOf(printed);
    throw std::invalid_argument(why.substr(0, why.find('\n')));
  }
  throw io::FileError(target + " could not be drawn by " + script +
                      "; install python3-matplotlib, or " + without);
}

}  // namespace

void drawReport(const fs::path& report, const fs::path& picture, const std::string& without) {
  run(report, picture, without, {});
}

std::string drawReportText(const std::string& report, const fs::path& picture,
                           const std::string& without, const ReportPart& beside) {
  const Folder folder;
  if (!beside.name.empty()) written(beside, folder);
  const fs::path printed = folder / "printed.txt";
  run(written({kReport, report}, folder), picture, without, printed);
  return contentOf(printed);
}

}  // namespace helix_arm::procedures
