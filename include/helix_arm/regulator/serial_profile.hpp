#pragma once

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/regulator/line_format.hpp"

namespace helix_arm::regulator {

/// How a device on a serial line writes and reads pressures: lines of text, as of LineFormat.
///
/// A device speaks one of three ways: one line a channel, each with its `{address}`, on being
/// asked; one line for all channels on being asked; or, without `read`, one line for all channels
/// unasked.
struct SerialProfile {
  std::string name;               ///< of the profile, for messages
  int baud = 115200;              ///< 8 data bits, no parity, 1 stop bit
  std::string terminator = "\n";  ///< of every line, both ways: CR, LF or both
  double pascals = 1e3;           ///< of one device unit [Pa]
  double atmosphere = 0;          ///< subtracted from readings, added to set points [Pa]; 0: gauge
  std::string unit_word;          ///< what {unit} must read
  int decimals = 2;               ///< of numbers in lines to the device, 0 to 6
  std::string separator = ";";    ///< of {pressures} in lines to the device
  std::string reply_separator = ";";  ///< of {pressures} in its own
  bool one_by_one = true;             ///< a line a channel; false: one for all channels

  std::vector<std::string> start;  ///< once connected; what they are answered is not looked at
  std::string write;               ///< set points
  std::string write_reply;         ///< what comes back; empty: nothing does
  std::string read;                ///< asks for readings; empty: the device sends them unasked
  std::string reply;               ///< a line of readings
  std::string supply_line;         ///< unasked, of its own, with {supply}; empty: none comes
  std::vector<std::string> skip;   ///< unasked lines that are not looked at
  /// Let the air out, of a channel where one_by_one; of a channel that is vented already the last
  /// one alone is sent again.
  std::vector<std::string> vent;
  std::vector<std::string> close;   ///< closes a channel's valves; empty: the device cannot
  std::vector<std::string> resume;  ///< after the first set point that follows on vent or close
  std::string vent_reply;           ///< to lines of vent, close and resume; empty: nothing comes
  double timeout = 0.1;             ///< of one exchange, or between lines that come unasked [s]
  /// The device vents all channels by itself once no line has come for so long [s]; infinite: it
  /// does not.
  double watchdog = std::numeric_limits<double>::infinity();

  /// A number of the device as gauge pressure [Pa].
  double toPascals(double number) const { return number * pascals - atmosphere; }
  /// The number of the device that is nearest to a gauge pressure [Pa].
  double fromPascals(double pressure) const { return (pressure + atmosphere) / pascals; }

  /// @throws std::invalid_argument naming the key and its rule.
  void validate() const;
};

/// The lines of a profile, made ready.
struct SerialLines {
  /// @throws std::invalid_argument naming the key and what is wrong with its line.
  explicit SerialLines(const SerialProfile& profile);

  std::vector<LineFormat> start, vent, close, resume, skip;
  std::optional<LineFormat> write, write_reply, read, reply, supply_line, vent_reply;
};

}  // namespace helix_arm::regulator
