#pragma once

#include <optional>
#include <string>

namespace helix_arm::regulator {

/// Whether SerialPort::open() knows this rate: 1200 to 2000000.
bool isStandardBaud(int baud);

/// A serial line with deadlines, as steadyNow() [s].
///
/// Once the device is gone, every call except close() throws LinkError naming the
/// device, the cause and the remedy.
class SerialPort {
 public:
  SerialPort() = default;
  ~SerialPort();
  SerialPort(const SerialPort&) = delete;
  SerialPort& operator=(const SerialPort&) = delete;

  /// Opens it raw, 8N1, exclusively (TIOCEXCL, and flock() for root, whom TIOCEXCL does not stop,
  /// and for pseudo terminals). An open line is closed first.
  /// @throws LinkError naming the device, the cause and the remedy.
  void open(const std::string& device, int baud);
  void close() noexcept;

  /// Drops the input received so far.
  /// @return whether there was any.
  bool discardInput();
  /// @throws LinkError also if the line does not accept it in time.
  void send(const std::string& bytes, double deadline);
  /// The next line, without its terminator; nothing at the deadline. An incomplete line is kept.
  /// @throws BadReply if the line exceeds kLongestLine; that much is dropped.
  std::optional<std::string> receiveLine(const std::string& terminator, double deadline);
  /// The incomplete line received so far.
  const std::string& unfinished() const { return input_; }

 private:
  void claim();
  void awaitSent() const noexcept;
  bool awaitInput(double deadline) const;
  std::size_t takeInput();
  [[noreturn]] void fail(const std::string& cause) const;

  std::string device_;
  std::string input_;
  int file_ = -1;
};

}  // namespace helix_arm::regulator
