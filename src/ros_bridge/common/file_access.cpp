#include "file_access.hpp"

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <optional>
#include <system_error>

#include <unistd.h>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/basics/text.hpp"

namespace helix_arm::ros_bridge {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLongestPath = 300;  // in a message

bool isBelow(const fs::path& path, const fs::path& folder) {
  const auto [of_folder, of_path] =
      std::mismatch(folder.begin(), folder.end(), path.begin(), path.end());
  return !folder.empty() && of_folder == folder.end() && of_path != path.end();
}

constexpr int kMostAncestors = 8;  // between a node and its roslaunch: launch-prefix, a shell

bool isSameFolder(const fs::path& a, const fs::path& b) {
  std::error_code fault;
  return fs::equivalent(a, b, fault) && !fault;
}

fs::path rosHome() { return fs::path(defaultFolder()).parent_path(); }

fs::path ofProcess(long process, const char* file) {
  return fs::path("/proc") / std::to_string(process) / file;
}

// `roslaunch ...` or `python3 .../roslaunch ...`. A rostest is one, too.
bool isLauncher(long process) {
  std::ifstream line(ofProcess(process, "cmdline"));
  std::string word;
  for (int k = 0; k < 3 && std::getline(line, word, '\0'); ++k) {
    const fs::path name = fs::path(word).filename();
    if (name == "roslaunch" || name == "rostest") return true;
  }
  return false;
}

// 0 if there is none.
long parentOf(long process) {
  std::ifstream file(ofProcess(process, "stat"));
  std::string text;
  std::getline(file, text, '\0');
  const std::size_t name_end = text.rfind(") ");  // then come the state and the parent
  if (name_end == std::string::npos || name_end + 4 > text.size()) return 0;
  return std::strtol(text.c_str() + name_end + 4, nullptr, 10);
}

std::optional<fs::path> launchersFolder() {
  long process = getppid();
  for (int k = 0; k < kMostAncestors && process > 1; ++k, process = parentOf(process)) {
    if (!isLauncher(process)) continue;
    std::error_code fault;
    const fs::path folder = fs::read_symlink(ofProcess(process, "cwd"), fault);
    if (fault) return std::nullopt;
    return folder;
  }
  return std::nullopt;
}

}  // namespace

std::string defaultFolder() {
  const char* const ros_home = std::getenv("ROS_HOME");
  if (ros_home != nullptr && *ros_home != '\0') return std::string(ros_home) + "/helix_arm";
  const char* const home = std::getenv("HOME");
  return std::string(home != nullptr ? home : "") + "/.ros/helix_arm";
}

std::string FileAccess::toRead(const std::string& what, const std::string& given,
                               const std::vector<std::string>& endings) const {
  std::string below;
  for (const Folder& folder : folders_) {
    below += (below.empty() ? " below " : " or ") + folder.path + " (" + folder.parameter + ")";
  }
  const std::string quoted = basics::quoted(given, kLongestPath);
  const auto require = [&](bool holds) {
    basics::require(holds, what, " is '", quoted, "'; expected the absolute path of a ",
                    basics::joined(endings, " or "), " file", below);
  };
  // The system would cut a path at a null character, and messages repeat it.
  require(!given.empty() && given.front() == '/' && basics::printable(given) == given);
  std::error_code fault;
  const fs::path path = fs::weakly_canonical(given, fault);
  require(!fault);
  require(std::any_of(folders_.begin(), folders_.end(), [&](const Folder& folder) {
    // Empty if the folder cannot be reached; no path is below that.
    std::error_code unreachable;
    return isBelow(path, fs::weakly_canonical(folder.path, unreachable));
  }));
  require(std::find(endings.begin(), endings.end(), path.extension()) != endings.end());
  std::error_code ignored;
  basics::require(fs::is_regular_file(path, ignored), what, " is '", quoted,
                  "', which is not a regular file");
  return path.string();
}

std::filesystem::path callersFolder() {
  const char* const pwd = std::getenv("PWD");
  const fs::path shell = pwd == nullptr ? "" : pwd;
  fs::path folder = fs::current_path();
  if (isSameFolder(folder, rosHome())) {
    if (const auto launcher = launchersFolder()) {
      folder = *launcher;
    } else if (shell.is_absolute()) {
      return shell;
    }
  }
  // PWD may reach the same folder over a link, by the name that the user knows.
  return shell.is_absolute() && isSameFolder(folder, shell) ? shell : folder;
}

}  // namespace helix_arm::ros_bridge
