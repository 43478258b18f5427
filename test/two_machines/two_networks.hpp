#pragma once

#include <stdexcept>
#include <string>
#include <vector>

#include <sys/types.h>

namespace helix_arm::test {

/// This process may not make network namespaces, or there is no program `ip` to fill them.
class NoNetworks : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A network namespace without a name, that of a child: it ends with the object or this process.
class NetworkNamespace {
 public:
  /// @throws NoNetworks          where the system refuses it.
  /// @throws std::runtime_error  where it cannot be made for another reason.
  NetworkNamespace();
  ~NetworkNamespace();
  NetworkNamespace(const NetworkNamespace&) = delete;
  NetworkNamespace& operator=(const NetworkNamespace&) = delete;

  /// Of the child, by which `ip` knows the namespace.
  std::string id() const { return std::to_string(child_); }
  /// A command that runs in it.
  std::vector<std::string> inside(const std::vector<std::string>& command) const;
  /// Moves this thread there, and all that it starts from now on.
  void enter() const;

 private:
  pid_t child_ = -1;
};

/// Two machines and the switch between them, as network namespaces of this one.
class TwoNetworks {
 public:
  /// @throws NoNetworks          where this process may not make them.
  /// @throws std::runtime_error  where they cannot be connected, with what was refused.
  TwoNetworks();

  void enterControl() const { control_.enter(); }
  /// A command that runs on the camera machine.
  std::vector<std::string> onCamera(const std::vector<std::string>& command) const {
    return camera_.inside(command);
  }

  /// Pulls the camera machine's cable, and puts it back.
  void cut() const;
  void heal() const;

  static constexpr char kControl[] = "10.77.0.1";
  static constexpr char kCamera[] = "10.77.0.2";

 private:
  void connect(const char* port, const NetworkNamespace& machine, const char* address) const;

  NetworkNamespace switch_, control_, camera_;
};

}  // namespace helix_arm::test
