#pragma once

#include <algorithm>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "helix_arm/regulator/driver.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"

namespace helix_arm::regulator {

/// Kind and abilities of a regulator, by its configuration and its profile.
struct DeviceFacts {
  std::string kind;               ///< its key in a scene
  std::string profile = {};       ///< name; empty if it has none
  std::string address = {};       ///< "/dev/ttyUSB0" or "terminal:502"; empty for a simulated one
  std::string host = {};          ///< of the address in a network; empty if it is in none
  std::string channel_word = {};  ///< "addresses" or "slots"; empty for a simulated one
  std::vector<std::string> channels = {};  ///< (actuators) their addresses or slots; may be empty
  std::vector<int> places = {};  ///< (actuators) index in the device; empty: the actuator's own
  bool closes_valves = false;    ///< FaultAction::kClose
  std::optional<int> most_channels = std::nullopt;  ///< of the device; absent: not known
  /// Highest set point, gauge [Pa]; infinite if that is not known.
  double highest_pressure = std::numeric_limits<double>::infinity();
  /// SerialProfile::watchdog [s].
  double watchdog = std::numeric_limits<double>::infinity();

  /// Index of an actuator's channel in the device.
  int place(int actuator) const {
    return places.empty() ? actuator : places[static_cast<std::size_t>(actuator)];
  }
  /// Channels of the device up to the last one that an arm of so many actuators uses.
  int used(int actuators) const {
    return places.empty() ? actuators : 1 + *std::max_element(places.begin(), places.end());
  }
};

inline constexpr double kPsi = 6894.757293168;  ///< [Pa]

/// Protocol of a device on a serial line: lines of text in the syntax of line_format.hpp.
///
/// There are three kinds of devices: one line per channel with its `{address}`, on request; one
/// line for all channels, on request; or, without `read`, one line for all channels, unsolicited.
struct SerialProfile {
  std::string name;               ///< name of the profile, for messages
  int baud = 115200;              ///< 8 data bits, no parity, 1 stop bit
  std::string terminator = "\n";  ///< of every line in both directions: CR, LF or both
  double pascals = 1e3;           ///< of one device unit [Pa]
  double atmosphere = 0;          ///< subtracted from readings, added to set points [Pa]; 0: gauge
  std::string unit_word;          ///< expected text of {unit}
  int decimals = 2;               ///< of numbers in lines to the device, 0 to 6
  std::string separator = ";";    ///< of {pressures} in lines to the device
  std::string reply_separator = ";";  ///< of {pressures} in the device's lines
  bool one_by_one = true;             ///< one line per channel; false: one for all channels
  bool checksum = false;              ///< withChecksum() of every line, in both directions

  std::vector<std::string> start;  ///< sent once connected; answers are ignored
  std::string unit_query;          ///< asked before the first set point; empty if there is none
  std::string unit_reply;          ///< answer to it, with {unit}
  std::string write;               ///< set points
  std::string write_reply;         ///< answer to it; empty if there is none
  std::string read;         ///< requests readings; empty if the device sends them unsolicited
  std::string reply;        ///< a line of readings
  std::string supply_line;  ///< separate unsolicited line with {supply}; empty if there is none
  std::vector<std::string> skip;  ///< unsolicited lines that are ignored
  /// Lines that vent, per channel if one_by_one. For a channel that is already vented, only the
  /// last line is sent again.
  std::vector<std::string> vent;
  std::vector<std::string> close;   ///< closes a channel's valves; empty if the device cannot
  std::vector<std::string> resume;  ///< sent after the first set point that follows vent or close
  /// Answer to the lines of vent, close and resume; empty if there is none.
  std::string vent_reply;
  double timeout = 0.1;  ///< of one exchange, or between unsolicited lines [s]
  /// Time without a line after which the device vents all channels by itself [s]; infinite if it
  /// does not.
  double watchdog = std::numeric_limits<double>::infinity();
  /// Highest set point that the device takes, gauge [Pa]; infinite if that is not known.
  double highest = std::numeric_limits<double>::infinity();
  std::optional<int> channels;  ///< of the device at most; absent: not known

  /// A number of the device as gauge pressure [Pa].
  double toPascals(double number) const { return number * pascals - atmosphere; }
  /// A gauge pressure [Pa] as a number of the device.
  double fromPascals(double pressure) const { return (pressure + atmosphere) / pascals; }
  /// The same by the name that profiles of all kinds have.
  double highestPressure() const { return highest; }

  /// @throws std::invalid_argument naming the key and its rule.
  void validate() const;
};

/// A regulator on a serial line that uses lines of text, as its profile says.
///
/// Its driver has one command outstanding at a time; input received before it was sent is not taken
/// as its answer. If one channel does not answer, the others are still written, vented and read;
/// the first error is thrown afterwards, and readings that succeeded are set. No answer is a
/// LinkError, a wrong answer a BadReply. Set points are rounded down to the device's decimals.
///
/// connect() also vents and reads once: a device that cannot be read is not ready. A channel that
/// is to close vents if the device cannot close. On a device with one line for all channels, those
/// that vent are set to zero pressure while others regulate. read() does not ask a channel whose
/// answer to the last write() was a reading. Unsolicited readings are not waited for: it returns
/// those received since the last call, NaN if there are none.
///
/// write(), vent() and read() block for at most the profile's timeout per exchanged line; connect()
/// for three timeouts more.
struct SerialConfig {
  static constexpr const char* kKind = "ascii_serial";
  SerialProfile profile;
  std::string device;                  ///< /dev/ttyUSB0, or better /dev/serial/by-id/...
  std::vector<std::string> addresses;  ///< (actuators) values of the profile's {address}

  DeviceFacts facts() const;
  /// @throws std::invalid_argument if the profile breaks its rules, or if its lines have {address}
  /// and the addresses are not one per channel, all different.
  std::unique_ptr<Driver> makeDriver(int channels) const;
};

/// An app of a device whose slots run one of several apps: one register commands it, another tells
/// its state.
struct ModbusApp {
  int command = 0;             ///< register, counted from the slot's first output
  int regulate = 0;            ///< word: regulate pressures
  int off = 0;                 ///< word: end the app, valves closed
  int acknowledge = 0;         ///< word: acknowledge faults, end the app
  int status = 0;              ///< register, counted from the slot's first input
  int status_mask = 0xffff;    ///< bits of the status that tell the slot's state
  int ready = 0;               ///< value of these bits once acknowledged
  int running = 0;             ///< value of these bits while the slot regulates
  double activation_time = 1;  ///< longest wait for either [s]
};

/// Register map of a device with Modbus TCP. Registers are numbered as on the wire.
///
/// A device has slots with one or more outlets each; an outlet is a pressure channel. A place is
/// the index of an outlet, counted from 0 through all slots.
struct ModbusProfile {
  std::string name;             ///< name of the profile, for messages
  int unit_id = 255;            ///< of the server
  double pascals = 100;         ///< of one count [Pa]; 100: millibar
  double atmosphere = 0;        ///< subtracted from readings, added to set points [Pa]; 0: gauge
  int highest_count = 32767;    ///< largest count that the device accepts; below 0 is never written
  int outlets = 1;              ///< of a slot
  std::optional<int> channels;  ///< outlets of the whole device at most; absent: not known

  int output_base = 0;      ///< first holding register to write
  int output_stride = 1;    ///< registers per slot
  int output_pressure = 0;  ///< set point of the slot's first outlet, counted from its first output
  int input_base = 0;       ///< first register to read
  int input_stride = 1;
  int input_pressure = 0;        ///< reading of the slot's first outlet
  bool input_registers = false;  ///< inputs are read by function 4, otherwise by function 3
  std::optional<int> supply;     ///< register of the supply's pressure; absent: not measured

  std::optional<ModbusApp> app;  ///< absent if slots can only regulate
  double timeout = 0.1;          ///< of one exchange [s]

  /// Highest set point that the device takes, gauge [Pa].
  double highestPressure() const { return highest_count * pascals - atmosphere; }
  /// Slot of a place.
  int slot(int place) const { return place / outlets; }
  /// Register of a place's set point.
  int setPoint(int place) const {
    return output_base + output_stride * slot(place) + output_pressure + place % outlets;
  }
  /// Register of a place's reading.
  int reading(int place) const {
    return input_base + input_stride * slot(place) + input_pressure + place % outlets;
  }
  /// Registers of a slot's app. Only with an app.
  int command(int slot) const { return output_base + output_stride * slot + app->command; }
  int status(int slot) const { return input_base + input_stride * slot + app->status; }

  /// @throws std::invalid_argument naming the key and its rule.
  void validate() const;
};

/// Reading of a register whose sensor is broken: the 16-bit number without an opposite. Not a
/// possible pressure.
inline constexpr int kNoReading = 0x8000;

/// A regulator on Modbus TCP, as its profile says.
///
/// Its driver rounds set points down to whole counts, within 0 and the highest count, so the
/// requested pressure is never exceeded. Slots without a used place are not written. In the other
/// slots all outlets are written, with 0 for outlets without a channel. vent() writes every
/// register even if the device does not answer. A register that reads kNoReading gives NaN; a
/// reading below vacuum is a BadReply.
///
/// In a device with apps, connect() acknowledges the faults of its slots and starts their apps at
/// set point 0. A slot closes if all its channels are to close; if only some are, those vent. A
/// slot that does not regulate within its activation time after the command is a LinkError:
/// reconnecting acknowledges its faults. Without a link running apps end, with the valves closed.
///
/// connect() takes at most the profile's timeout to resolve and again to reach the device (per
/// address, if the name has several), and twice its activation time. After any LinkError,
/// everything except vent() is refused until connect(). A reply that is late, cut short or garbled
/// to its end counts as a lost link; a complete but invalid reply is a BadReply. Orders that are
/// not one per channel, or not finite, throw std::invalid_argument.
struct ModbusConfig {
  static constexpr const char* kKind = "modbus_tcp";
  ModbusProfile profile;
  std::string host;  ///< name or address
  int port = 502;
  std::vector<int> slots;  ///< (actuators) outlet in the device, from 0

  DeviceFacts facts() const;
  /// @throws std::invalid_argument if the profile breaks its rules, or slots are missing, negative,
  /// repeated, beyond the last register, or not one per channel.
  std::unique_ptr<Driver> makeDriver(int channels) const;
};

/// The regulator of a scene, one of the kinds that say everything about themselves.
using Config = std::variant<SimulatedRegulatorConfig, SerialConfig, ModbusConfig>;
/// Their keys in a scene; all except the first are hardware.
inline constexpr const char* kKinds[] = {SimulatedRegulatorConfig::kKind, SerialConfig::kKind,
                                         ModbusConfig::kKind};
/// The profile of one.
using Profile = std::variant<SerialProfile, ModbusProfile>;

DeviceFacts factsOf(const Config& config);  ///< those of the regulator's kind
/// "simulated", or the kind with its profile and address: "ascii_serial alicat at /dev/ttyUSB0".
std::string describe(const Config& config);
/// Positions of the actuators in the device, in their order: "addresses A, B, C" or "slots 0, 1,
/// 2"; empty for a simulated one.
std::string describeChannels(const Config& config);
/// Position of one channel in the device: its address or slot, else its number from 0.
std::string addressOf(const Config& config, int channel);
/// Whether it is real hardware, which moves air.
bool isHardware(const Config& config);

/// Makes the driver of a regulator with this number of channels; it is not connected yet.
/// @throws std::invalid_argument if the configuration does not have this number of channels.
std::unique_ptr<Driver> makeDriver(const Config& config, int channels);

}  // namespace helix_arm::regulator
