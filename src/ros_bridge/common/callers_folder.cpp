#include "ros_bridge/common/callers_folder.hpp"

#include <cstdlib>
#include <fstream>
#include <optional>
#include <string>
#include <system_error>

#include <unistd.h>

#include "ros_bridge/common/file_access.hpp"

namespace helix_arm::ros_bridge {
namespace {

namespace fs = std::filesystem;

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
