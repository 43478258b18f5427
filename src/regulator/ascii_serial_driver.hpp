#pragma once

#include <string>
#include <vector>

#include "helix_arm/control/safety.hpp"
#include "helix_arm/regulator/config.hpp"
#include "helix_arm/regulator/driver.hpp"
#include "helix_arm/regulator/serial_profile.hpp"
#include "serial_port.hpp"

namespace helix_arm::regulator {

/// Driver of a regulator on a serial line that uses lines of text, as its profile says.
///
/// One command is outstanding at a time; input received before it was sent is not taken as its
/// answer. If one channel does not answer, the others are still written, vented and read; the first
/// error is thrown afterwards. No answer is a LinkError, a wrong answer a BadReply. Set points are
/// rounded down to the device's decimals.
///
/// write(), vent() and read() block for at most the profile's timeout per exchanged line; connect()
/// for three timeouts more.
class AsciiSerialDriver : public Driver {
 public:
  /// @throws std::invalid_argument if the profile breaks its rules, or if its lines have {address}
  /// and the addresses are not one per channel, all different.
  AsciiSerialDriver(const SerialConfig& config, int channels);

  /// Also vents and reads once: a device that cannot be read is not ready.
  void connect() override;
  /// A channel that is to close vents if the device cannot close. On a device with one line for all
  /// channels, those that vent are set to zero pressure while others regulate.
  void write(const control::ValveOrders& orders) override;
  /// Does not ask a channel whose answer to the last write() was a reading. Unsolicited readings
  /// are not waited for: it returns those received since the last call, NaN if there are none. The
  /// readings that succeeded are set even if it throws.
  void read(Pressures& pressures) override;
  void vent() override;
  double watchdog() const noexcept override { return profile_.watchdog; }
  void close() noexcept override;

 private:
  enum class State { kUnknown, kVented, kClosed, kRegulates };
  struct Channel {
    std::string address;
    State state = State::kUnknown;
    std::optional<double> sent;           // set point [device units]; absent unless it regulates
    std::vector<double> readings;         // not yet returned by read() [Pa]
    SerialPort::Clock::time_point heard;  // time of the last reading
  };

  void ready();
  void awaitQuiet();
  void awaitReading();
  LineFields exchange(const LineFormat& command, const LineFormat* reply, Channel& channel,
                      const LineFields& values = {});
  void exchangeAll(const std::vector<LineFormat>& commands, Channel& channel);
  void noteSilence();
  void requireWatched();
  void note(const LineFields& fields, Channel& channel);
  double numberOf(double pressure) const;
  double reading(double number) const;
  void writeChannel(Channel& channel, control::Valve valve, double set_point);
  void writeTogether(const control::ValveOrders& orders);
  void ventChannel(Channel& channel);
  void closeChannel(Channel& channel);
  void regulate(Channel& channel, const LineFields& values);
  bool listen(SerialPort::Clock::time_point deadline);
  void ask();
  void overhear();

  SerialProfile profile_;
  SerialLines lines_;
  std::string device_;
  int count_;                      // channels
  std::vector<Channel> channels_;  // a single one if one line serves all channels
  std::optional<double> supply_;   // not yet returned by read() [Pa]
  SerialPort port_;
  SerialPort::Clock::time_point last_line_;  // sent
  bool lapsed_ = false;  // the device's watchdog may have expired since it vented
};

}  // namespace helix_arm::regulator
