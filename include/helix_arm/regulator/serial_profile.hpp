#pragma once

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/regulator/line_format.hpp"

namespace helix_arm::regulator {

/// Protocol of a device on a serial line: lines of text in the syntax of LineFormat.
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

/// The parsed lines of a profile.
struct SerialLines {
  /// @throws std::invalid_argument naming the key and the fault in its line.
  explicit SerialLines(const SerialProfile& profile);

  std::vector<LineFormat> start, vent, close, resume, skip;
  std::optional<LineFormat> write, write_reply, read, reply, supply_line, vent_reply;
};

}  // namespace helix_arm::regulator
