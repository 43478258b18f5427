#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace helix_arm::regulator {

/// Values of a template's fields. All numbers are in the device's unit.
struct LineFields {
  std::vector<double> pressures;    ///< of {pressure}, or all of {pressures}
  std::optional<double> set_point;  ///< of {set_point}
  std::optional<double> supply;     ///< of {supply}
};

/// How the fields of a line are written.
struct LineStyle {
  std::string separator = ";";  ///< between the numbers of {pressures}
  std::string unit_word;        ///< text of {unit}
  int decimals = 2;             ///< decimals of every number, 0 to 6
};

/// Longest line that is read or written [bytes].
inline constexpr std::size_t kLongestLine = 512;

/// The line followed by "*" and its checksum, four upper-case hexadecimal digits: CRC-16/IBM-3740
/// (polynomial 0x1021, initial value 0xFFFF, not reflected) of the bytes before "*".
std::string withChecksum(const std::string& line);
/// The part of a line before its checksum, ignoring terminator and blanks at its end; nothing if
/// the checksum is missing or wrong. Up to kLongestLine, one or two flipped bits are always found.
std::optional<std::string> withoutChecksum(std::string_view line);

/// A template of a text line with fields, parsed once: writes and reads such lines.
///
/// Fields: `{address}`; `{pressure}`, or `{pressures}` with the separator between; `{set_point}`,
/// `{supply}`; `{unit}`; `{*}`, a word that is ignored; and at the end `{words}`, any number of
/// words of letters, or `{...}`, anything. The rest is literal, except that blanks (spaces, tabs)
/// in the template match one or more blanks.
///
/// Numbers are decimal, such as "+014.70", "-3" or "1e2", with at most 15 digits, in any locale.
/// The result of reading depends only on the template and the bytes.
class LineFormat {
 public:
  /// @throws std::invalid_argument describing the fault in the text.
  explicit LineFormat(const std::string& text, LineStyle style = {});

  /// Whether it has a field, for example has("{address}").
  bool has(std::string_view field) const;

  /// The line with its fields filled in, without a terminator. A number that is not finite becomes
  /// "nan", `{*}` a 0, `{words}` and `{...}` nothing.
  /// @throws std::invalid_argument if a field has no value, or one of 1e9 or more.
  std::string line(const std::string& address, const LineFields& fields) const;

  /// The fields of a line, ignoring its terminator and blanks at its ends; nothing if the line does
  /// not match.
  /// @param pressures  number of values that {pressures} must hold.
  std::optional<LineFields> match(std::string_view line, const std::string& address,
                                  std::size_t pressures) const;
  /// Like match(). @throws BadReply quoting the line, the template and the position of the
  /// mismatch.
  LineFields parse(std::string_view line, const std::string& address, std::size_t pressures) const;

 private:
  struct Mismatch {
    std::size_t at = 0;
    std::string expected;
  };
  class Reader;

  void demand(bool holds, const std::string& fault) const;
  void checkFields() const;
  std::optional<LineFields> read(std::string_view line, const std::string& address,
                                 std::size_t pressures, Mismatch& mismatch) const;

  std::string text_;
  LineStyle style_;
  std::vector<std::string> parts_;  ///< fields, blanks and what is literal
};

struct SerialProfile;

/// The parsed lines of a profile.
struct SerialLines {
  /// @throws std::invalid_argument naming the key and the fault in its line.
  explicit SerialLines(const SerialProfile& profile);

  std::vector<LineFormat> start, vent, close, resume, skip;
  std::optional<LineFormat> unit_query, unit_reply;
  std::optional<LineFormat> write, write_reply, read, reply, supply_line, vent_reply;
};

}  // namespace helix_arm::regulator
