#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace helix_arm::regulator {

/// What stands in a line in place of a template's fields. All numbers are in the device's unit.
struct LineFields {
  std::vector<double> pressures;    ///< of {pressure}, or all of {pressures}
  std::optional<double> set_point;  ///< of {set_point}
  std::optional<double> supply;     ///< of {supply}
};

/// How the fields of a line are written.
struct LineStyle {
  std::string separator = ";";  ///< between the numbers of {pressures}
  std::string unit_word;        ///< what {unit} stands for
  int decimals = 2;             ///< of every number, 0 to 6
};

/// Longest line that is read or written [bytes].
inline constexpr std::size_t kLongestLine = 512;

/// A line of text with fields in it, made ready once: writes such lines and reads them.
///
/// Fields: `{address}`; `{pressure}`, or `{pressures}` with the separator between; `{set_point}`,
/// `{supply}`; `{unit}`; `{*}`, a word that is not looked at; and at the end `{words}`, any number
/// of words of letters, or `{...}`, whatever comes. The rest is literal, but blanks (spaces, tabs)
/// in the template stand for one or more of them.
///
/// Numbers are decimal, as "+014.70", "-3" or "1e2", of at most 15 digits, whatever the locale.
/// Reading depends on nothing but the template and the bytes.
class LineFormat {
 public:
  /// @throws std::invalid_argument saying what is wrong with the text.
  explicit LineFormat(const std::string& text, LineStyle style = {});

  const std::string& text() const { return text_; }
  /// Whether it has a field, as in has("{address}").
  bool has(std::string_view field) const;

  /// The line with its fields filled in, without a terminator. A number that is not finite becomes
  /// "nan", `{*}` a 0, `{words}` and `{...}` nothing.
  /// @throws std::invalid_argument where a field has no value, or one of 1e9 or more.
  std::string line(const std::string& address, const LineFields& fields) const;

  /// The fields of a line, its terminator and blanks at its ends left out; nothing when it is no
  /// such line.
  /// @param pressures  how many {pressures} must hold.
  std::optional<LineFields> match(std::string_view line, const std::string& address,
                                  std::size_t pressures) const;
  /// The same. @throws BadReply quoting the line, the template and where they part.
  LineFields parse(std::string_view line, const std::string& address, std::size_t pressures) const;

 private:
  enum class Kind {
    kLiteral,
    kBlank,
    kAddress,
    kPressure,
    kPressures,
    kSetPoint,
    kSupply,
    kUnit,
    kWord,
    kWords,
    kRest
  };
  struct Part {
    Kind kind;
    std::string text;  ///< as it stands in the template
  };
  struct Mismatch {
    std::size_t at = 0;
    std::string expected;
  };
  class Reader;

  std::optional<LineFields> read(std::string_view line, const std::string& address,
                                 std::size_t pressures, Mismatch& mismatch) const;

  std::string text_;
  LineStyle style_;
  std::vector<Part> parts_;
};

}  // namespace helix_arm::regulator
