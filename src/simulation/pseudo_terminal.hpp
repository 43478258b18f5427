#pragma once

#include <optional>
#include <string>

namespace helix_arm::simulation {

/// The device's end of a pseudo terminal, which nobody has opened on the other end yet.
class PseudoTerminal {
 public:
  /// @throws std::runtime_error where the system gives none.
  PseudoTerminal();
  ~PseudoTerminal();
  PseudoTerminal(const PseudoTerminal&) = delete;
  PseudoTerminal& operator=(const PseudoTerminal&) = delete;

  int file() const { return file_; }                 ///< to wait for
  const std::string& path() const { return path_; }  ///< of the other end
  /// What has come, perhaps nothing; absent while nobody is on the other end.
  std::optional<std::string> receive();
  /// What does not fit is lost, as on a line that nobody reads.
  void send(const std::string& bytes);

 private:
  int file_ = -1;
  std::string path_;
};

/// A symlink that stands as long as the object.
class DeviceLink {
 public:
  /// @param path  empty: none is made.
  explicit DeviceLink(std::string path) : path_(std::move(path)) {}
  ~DeviceLink();
  DeviceLink(const DeviceLink&) = delete;
  DeviceLink& operator=(const DeviceLink&) = delete;

  const std::string& path() const { return path_; }
  /// Lets it point there, in one step.
  /// @throws std::runtime_error where it cannot, or where something else has its place: what is no
  /// symlink, or one to another pseudo terminal that exists.
  void pointTo(const std::string& target);

 private:
  std::string path_;
  std::string target_;
};

}  // namespace helix_arm::simulation
