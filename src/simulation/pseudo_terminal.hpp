#pragma once

#include <optional>
#include <string>

namespace helix_arm::simulation {

/// The device's end of a pseudo terminal whose other end is not open yet.
class PseudoTerminal {
 public:
  /// @throws std::runtime_error if the system provides none.
  PseudoTerminal();
  ~PseudoTerminal();
  PseudoTerminal(const PseudoTerminal&) = delete;
  PseudoTerminal& operator=(const PseudoTerminal&) = delete;

  int file() const { return file_; }                 ///< to wait for
  const std::string& path() const { return path_; }  ///< of the other end
  /// Received bytes, possibly none; absent while the other end is not open.
  std::optional<std::string> receive();
  /// Sends bytes; those that do not fit are lost, as on a line that nobody reads.
  void send(const std::string& bytes);

 private:
  int file_ = -1;
  std::string path_;
};

/// A symlink that exists as long as the object.
class DeviceLink {
 public:
  /// @param path  if empty, no link is made.
  explicit DeviceLink(std::string path) : path_(std::move(path)) {}
  ~DeviceLink();
  DeviceLink(const DeviceLink&) = delete;
  DeviceLink& operator=(const DeviceLink&) = delete;

  const std::string& path() const { return path_; }
  /// Points the link to the target, atomically.
  /// @throws std::runtime_error if it cannot, or if its path is taken: by anything but a symlink,
  /// or by one to another existing pseudo terminal.
  void pointTo(const std::string& target);

 private:
  std::string path_;
  std::string target_;
};

}  // namespace helix_arm::simulation
