#pragma once

#include <functional>
#include <string>
#include <vector>

#include "helix_arm/control/valve_orders.hpp"
#include "helix_arm/regulator/config.hpp"
#include "helix_arm/regulator/driver.hpp"
#include "helix_arm/regulator/serial_port.hpp"
#include "helix_arm/regulator/serial_profile.hpp"

namespace helix_arm::regulator {

/// A regulator on a serial line that speaks in lines of text, as its profile says.
///
/// One command is outstanding at a time, and what came before it was sent is no answer to it. Where
/// one channel does not answer, the others are still written, vented and read; the first error is
/// thrown afterwards. A device that says nothing is a LinkError, one that says something else a
/// BadReply. Set points are rounded down to the device's decimals.
///
/// write(), vent() and read() block for at most the profile's timeout each line that they exchange;
/// connect() for three more.
class AsciiSerialDriver : public Driver {
 public:
  /// @throws std::invalid_argument when the profile breaks its rules, or the addresses are not one
  /// a channel, each once, where its lines have {address}.
  AsciiSerialDriver(const SerialConfig& config, int channels);

  /// Also vents, and reads once: a device that cannot be read is not ready.
  void connect() override;
  /// A channel that is to close, on a device that cannot, vents. Of a device with one line for all
  /// channels, those that vent are set to no pressure while others regulate.
  void write(const control::ValveOrders& orders) override;
  /// Does not ask a channel whose answer to the last write() was a reading. Where readings come
  /// unasked it does not wait: those that came since the last call, NaN when none did. What could
  /// be read is there also when it throws.
  void read(Pressures& pressures) override;
  void vent() override;
  double watchdog() const noexcept override { return profile_.watchdog; }
  void close() noexcept override;

 private:
  enum class State { kUnknown, kVented, kClosed, kRegulates };
  struct Channel {
    std::string address;
    State state = State::kUnknown;
    std::optional<double> sent;    // set point [device units]; absent where it does not regulate
    std::vector<double> readings;  // that read() has not handed out yet [Pa]
    SerialPort::Clock::time_point heard;  // when the last of them came
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
  void eachChannel(const std::function<void(Channel&, int)>& call);
  bool listen(SerialPort::Clock::time_point deadline);
  void ask();
  void overhear();

  SerialProfile profile_;
  SerialLines lines_;
  std::string device_;
  int count_;                      // channels
  std::vector<Channel> channels_;  // one that stands for all, where one line does
  std::optional<double> supply_;   // not handed out yet [Pa]
  SerialPort port_;
  SerialPort::Clock::time_point last_line_;  // sent
  bool lapsed_ = false;                      // the device's watchdog may have, since it vented
};

}  // namespace helix_arm::regulator
