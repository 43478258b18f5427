#pragma once

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>

#include <fcntl.h>
#include <termios.h>
#include <unistd.h>

namespace helix_arm::simulation {

/// @throws std::runtime_error with what and the system's reason.
[[noreturn]] inline void failSystemCall(const std::string& what, int error = errno) {
  throw std::runtime_error(what + ": " + std::strerror(error));
}

/// The device's end of a pseudo terminal whose other end is not open yet.
class PseudoTerminal {
 public:
  /// @throws std::runtime_error if the system provides none.
  PseudoTerminal() {
    file_ = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (file_ < 0) failSystemCall("no pseudo terminal is available");
    char path[128];
    if (grantpt(file_) != 0 || unlockpt(file_) != 0 || ptsname_r(file_, path, sizeof path) != 0) {
      const int error = errno;
      close(file_);
      failSystemCall("a pseudo terminal cannot be unlocked", error);
    }
    path_ = path;
    // Raw mode from the start; otherwise the terminal would echo until a program opens it.
    const int other = open(path, O_RDWR | O_NOCTTY | O_CLOEXEC);
    termios settings{};
    if (other < 0 || tcgetattr(other, &settings) != 0) {
      const int error = errno;
      if (other >= 0) close(other);
      close(file_);
      failSystemCall(path_ + " cannot be opened", error);
    }
    cfmakeraw(&settings);
    tcsetattr(other, TCSANOW, &settings);
    close(other);
  }
  ~PseudoTerminal() { close(file_); }
  PseudoTerminal(const PseudoTerminal&) = delete;
  PseudoTerminal& operator=(const PseudoTerminal&) = delete;

  int file() const { return file_; }                 ///< to wait for
  const std::string& path() const { return path_; }  ///< of the other end

  /// Received bytes, possibly none; absent while the other end is not open.
  std::optional<std::string> receive() {
    char bytes[512];
    const ssize_t count = read(file_, bytes, sizeof bytes);
    if (count > 0) return std::string(bytes, static_cast<std::size_t>(count));
    if (count < 0 && (errno == EAGAIN || errno == EINTR)) return std::string();
    return std::nullopt;
  }

  /// Sends bytes; those that do not fit are lost, as on a line that nobody reads.
  void send(const std::string& bytes) {
    for (std::size_t sent = 0; sent < bytes.size();) {
      const ssize_t count = write(file_, bytes.data() + sent, bytes.size() - sent);
      if (count <= 0) return;
      sent += static_cast<std::size_t>(count);
    }
  }

 private:
  int file_ = -1;
  std::string path_;
};

/// A symlink that exists as long as the object.
class DeviceLink {
 public:
  /// @param path  if empty, no link is made.
  explicit DeviceLink(std::string path) : path_(std::move(path)) {}
  ~DeviceLink() {
    std::error_code ignored;
    if (!path_.empty() && std::filesystem::read_symlink(path_, ignored) == target_) {
      std::filesystem::remove(path_, ignored);
    }
  }
  DeviceLink(const DeviceLink&) = delete;
  DeviceLink& operator=(const DeviceLink&) = delete;

  const std::string& path() const { return path_; }
  /// Points the link to the target, atomically.
  /// @throws std::runtime_error if it cannot, or if its path is taken: by anything but a symlink,
  /// or by one to another existing pseudo terminal.
  void pointTo(const std::string& target) {
    if (path_.empty()) return;
    std::error_code ignored;
    const auto there = std::filesystem::symlink_status(path_, ignored);
    if (std::filesystem::exists(there) && !std::filesystem::is_symlink(there)) {
      throw std::runtime_error(
          path_ + " exists and is not a symlink; expected a path where one can be created");
    }
    const std::filesystem::path other = std::filesystem::canonical(path_, ignored);
    if (other.parent_path() == "/dev/pts" && other != target_ && other != target) {
      throw std::runtime_error(
          path_ + " points to " + other.string() +
          ", which is in use; end the program that made it, or remove the link");
    }
    const std::string fresh = path_ + "." + std::to_string(getpid());
    std::filesystem::remove(fresh, ignored);
    if (symlink(target.c_str(), fresh.c_str()) != 0) failSystemCall(fresh + " cannot be created");
    if (rename(fresh.c_str(), path_.c_str()) != 0) {
      const int error = errno;
      std::filesystem::remove(fresh, ignored);
      failSystemCall(path_ + " cannot be created", error);
    }
    target_ = target;
  }

 private:
  std::string path_;
  std::string target_;
};

}  // namespace helix_arm::simulation
