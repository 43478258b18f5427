#pragma once

#include <chrono>
#include <optional>
#include <string>

namespace helix_arm::regulator {

/// A serial line that is waited for at most until a deadline.
///
/// Every call but close() and isOpen() throws LinkError naming the device, the cause and the
/// remedy, once the device is gone.
class SerialPort {
 public:
  using Clock = std::chrono::steady_clock;

  SerialPort() = default;
  ~SerialPort();
  SerialPort(const SerialPort&) = delete;
  SerialPort& operator=(const SerialPort&) = delete;

  /// Opens it raw, 8N1, for nobody else (TIOCEXCL, and flock() for root, whom that does not stop,
  /// and on pseudo terminals); an open one is closed first.
  /// @throws LinkError naming the device, the cause and the remedy.
  void open(const std::string& device, int baud);
  void close() noexcept;
  bool isOpen() const { return file_ >= 0; }

  /// Drops what has come in so far.
  /// @return whether there was any.
  bool discardInput();
  /// @throws LinkError also where the line does not take it in time.
  void send(const std::string& bytes, Clock::time_point deadline);
  /// The next line, without its terminator; nothing when the deadline passes, what has come of it
  /// is kept.
  /// @throws BadReply where it grows longer than kLongestLine; that much is dropped.
  std::optional<std::string> receiveLine(const std::string& terminator, Clock::time_point deadline);
  /// What has come of a line that has not ended yet.
  const std::string& unfinished() const { return input_; }

 private:
  void claim();
  void awaitSent() const noexcept;
  bool awaitInput(Clock::time_point deadline) const;
  std::size_t takeInput();
  [[noreturn]] void fail(const std::string& cause) const;

  std::string device_;
  std::string input_;
  int file_ = -1;
};

}  // namespace helix_arm::regulator
