#include "report_plot.hpp"

#include <cerrno>
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

#include "io/document/atomic_file.hpp"
#include "io/scene/shipped_files.hpp"

namespace helix_arm::procedures {
namespace {

namespace fs = std::filesystem;

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

// Runs a program with its stdout in a file. @return its exit code; -1 where it did not run to its
// end.
int exitCodeOf(std::vector<std::string> words, const fs::path& printed) {
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, printed.c_str(), O_WRONLY | O_CREAT,
                                   S_IRUSR | S_IWUSR);
  pid_t child = 0;
  int status = 0;
  const int failed =
      posix_spawn(&child, arguments[0], &actions, nullptr, arguments.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  while (failed == 0 && waitpid(child, &status, 0) < 0 && errno == EINTR) continue;
  return failed == 0 && WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

}  // namespace

fs::path scriptPath(const std::string& script) {
  std::error_code error;
  const fs::path beside = fs::read_symlink("/proc/self/exe", error).parent_path() / script;
  return fs::exists(beside, error) ? beside : fs::path(io::shippedFolder("scripts")) / script;
}

std::string runScript(const std::string& script, const std::string& report,
                      const std::vector<std::string>& arguments, const std::string& failure,
                      const ReportPart& beside) {
  constexpr int kRefused = 3;  // exit code; it prints why
  const Folder folder;
  if (!beside.name.empty()) written(beside, folder);
  const fs::path printed = folder / "printed.txt";
  std::vector<std::string> words{scriptPath(script), written({"report.json", report}, folder)};
  words.insert(words.end(), arguments.begin(), arguments.end());
  const int exit_code = exitCodeOf(words, printed);
  std::string text = contentOf(printed);
  if (exit_code == 0) return text;
  if (exit_code == kRefused) throw std::invalid_argument(text.substr(0, text.find('\n')));
  throw io::FileError(failure);
}

std::string drawReport(const std::string& report, const fs::path& picture,
                       const std::string& without, const ReportPart& beside) {
  const std::string script = "plot_report";
  return runScript(script, report, {picture},
                   picture.string() + " could not be drawn by " + scriptPath(script).string() +
                       "; install python3-matplotlib, or " + without,
                   beside);
}

}  // namespace helix_arm::procedures
