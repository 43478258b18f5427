#pragma once

#include <Eigen/Core>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include <fcntl.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include "emulated_device.hpp"

namespace helix_arm::simulation {

/// @throws std::runtime_error with what and the system's reason.
[[noreturn]] inline void failSystemCall(const std::string& what, int error = errno) {
  throw std::runtime_error(what + ": " + std::strerror(error));
}

/// An open file that bytes come from and go to without waiting. It is closed at the end.
class Stream {
 public:
  explicit Stream(int file = -1) : file_(file) {}
  Stream(Stream&& other) noexcept : file_(std::exchange(other.file_, -1)) {}
  Stream& operator=(Stream&& other) noexcept {
    std::swap(file_, other.file_);
    return *this;
  }
  ~Stream() {
    if (file_ >= 0) close(file_);
  }

  int file() const { return file_; }  ///< to wait for

  /// Received bytes, possibly none; absent while the other end is not open.
  std::optional<std::string> receive() const {
    char bytes[512];
    const ssize_t count = read(file_, bytes, sizeof bytes);
    if (count > 0) return std::string(bytes, static_cast<std::size_t>(count));
    if (count < 0 && (errno == EAGAIN || errno == EINTR)) return std::string();
    return std::nullopt;
  }

  /// Sends bytes; those that do not fit are lost, as on a line that nobody reads.
  void send(const std::string& bytes) const {
    for (std::size_t sent = 0; sent < bytes.size();) {
      const char* const next = bytes.data() + sent;
      ssize_t count = ::send(file_, next, bytes.size() - sent, MSG_NOSIGNAL);
      if (count < 0 && errno == ENOTSOCK) count = write(file_, next, bytes.size() - sent);
      if (count <= 0) return;
      sent += static_cast<std::size_t>(count);
    }
  }

 private:
  int file_;
};

/// The device's end of a pseudo terminal whose other end is not open yet.
class PseudoTerminal : public Stream {
 public:
  /// @throws std::runtime_error if the system provides none.
  PseudoTerminal() : Stream(posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)) {
    if (file() < 0) failSystemCall("no pseudo terminal is available");
    char path[128];
    if (grantpt(file()) != 0 || unlockpt(file()) != 0 ||
        ptsname_r(file(), path, sizeof path) != 0) {
      failSystemCall("a pseudo terminal cannot be unlocked");
    }
    path_ = path;
    // Raw mode from the start; otherwise the terminal would echo until a program opens it.
    const Stream other(open(path, O_RDWR | O_NOCTTY | O_CLOEXEC));
    termios settings{};
    if (other.file() < 0 || tcgetattr(other.file(), &settings) != 0) {
      failSystemCall(path_ + " cannot be opened");
    }
    cfmakeraw(&settings);
    tcsetattr(other.file(), TCSANOW, &settings);
  }

  const std::string& path() const { return path_; }  ///< of the other end

 private:
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

/// Valves, faults and clients of an emulated device, which all kinds have. What differs is how it
/// listens and what it makes of a request. Nothing waits; for one thread, or behind one lock.
class Emulation {
 public:
  /// How it speaks.
  struct DeviceTiming {
    double timeout;                                           ///< of its profile [s]
    std::string terminator;                                   ///< behind each answer
    double period = std::numeric_limits<double>::infinity();  ///< of unsolicited answers [s]
    std::uint32_t seed = 1;                                   ///< of the garbage
  };
  Emulation(int channels, const regulator::SimulatedRegulatorConfig& valves, DeviceTiming timing);
  virtual ~Emulation() = default;

  /// Does what is due. @return the longest wait until the next call, unless a file is ready [s].
  double work();
  std::vector<int> files() const;
  void setFault(DeviceFault fault);
  /// Lets the valves move until now.
  void catchUp();

  DeviceFault fault() const { return fault_; }
  std::uint64_t taken() const { return taken_; }
  std::uint64_t restarts() const { return restarts_; }
  double lastSetTime() const { return last_set_; }
  int connections() const { return static_cast<int>(clients_.size()); }
  const Eigen::VectorXd& pressure() const { return regulator_.pressure(); }

  virtual Eigen::VectorXd setPoint() const = 0;
  virtual std::vector<control::Valve> valves() const = 0;
  virtual std::string path() const { return {}; }
  virtual int port() const { return 0; }
  virtual void jam(int, bool) {}

 protected:
  struct Client {
    Stream stream;
    std::string input = {};  // the begin of a request
    bool is_there = true;    // false while nobody has opened a terminal
    std::deque<std::pair<double, std::string>> late = {};  // answers, and when they are due [s]
  };
  struct Outcome {
    bool taken = false, sets = false;
    std::optional<std::string> answer = std::nullopt;  // without terminator
  };

  /// Opens its line anew, to no client or the next one. @return false: only closed it, for now.
  /// @throws std::runtime_error if it cannot be opened.
  virtual bool open() = 0;
  /// File that new clients arrive at; below 0: its one client stays.
  virtual int listener() const { return -1; }
  virtual void accept() {}
  /// The last client has gone.
  virtual void loseLink() {}
  /// Takes the next whole request from what was received.
  virtual std::optional<std::string> next(std::string& input) const = 0;
  virtual Outcome take(const std::string& request) = 0;
  virtual std::optional<std::string> unasked() { return std::nullopt; }
  /// As after power-on.
  virtual void restart() = 0;
  virtual void step(double dt) { regulator_.step(dt); }

  /// (channels) under the fault, NaN where there is none [Pa].
  Eigen::VectorXd readings();

  const DeviceTiming timing_;
  regulator::SimulatedRegulator regulator_;
  std::vector<Client> clients_;
  DeviceFault fault_ = DeviceFault::kNone;
  double time_;  // of the valves, as regulator::steadyNow() [s]

 private:
  bool comesBack();
  void hear(std::size_t client);
  void say(Client& client, std::string answer);
  double sendLate();

  Eigen::VectorXd stuck_;  // readings of kStuckValue
  bool is_away_ = false;   // restarts
  double next_unasked_ = 0;
  std::uint64_t taken_ = 0, restarts_ = 0;
  double last_set_ = -std::numeric_limits<double>::infinity();
  std::mt19937 generator_;
};

/// The device of a kind of regulator. Throw as EmulatedDevice.
/// @param config  its `regulator` is this one.
std::unique_ptr<Emulation> emulate(const regulator::SerialConfig& regulator,
                                   const EmulatedDeviceConfig& config);
std::unique_ptr<Emulation> emulate(const regulator::ModbusConfig& regulator,
                                   const EmulatedDeviceConfig& config);

}  // namespace helix_arm::simulation
