#include "helix_arm/regulator/serial_profile.hpp"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <stdexcept>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::regulator {
namespace {

constexpr const char* kCulprit = "serial profile";
constexpr int kMostChannels = 1024;

template <class Value>
void require(bool holds, const char* key, const Value& value, const char* rule) {
  basics::requireValue(holds, kCulprit, key, value, rule);
}

LineFormat formatOf(const char* key, const std::string& text, const LineStyle& style) {
  try {
    return LineFormat(text, style);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(std::string(kCulprit) + ": " + key + " " + error.what());
  }
}

std::optional<LineFormat> optionalFormat(const char* key, const std::string& text,
                                         const LineStyle& style) {
  return text.empty() ? std::nullopt : std::optional(formatOf(key, text, style));
}

std::vector<LineFormat> formats(const char* key, const std::vector<std::string>& texts,
                                const LineStyle& style) {
  std::vector<LineFormat> lines;
  for (const std::string& text : texts) lines.push_back(formatOf(key, text, style));
  return lines;
}

// A line to the device must not have fields that cannot be filled in.
void requireSendable(const char* key, const LineFormat& line,
                     std::initializer_list<const char*> allowed) {
  for (const char* field : {"{address}", "{pressure}", "{pressures}", "{set_point}", "{supply}",
                            "{*}", "{words}", "{...}"}) {
    const bool known = std::any_of(allowed.begin(), allowed.end(), [&](const char* word) {
      return std::string_view(word) == field;
    });
    basics::require(known || !line.has(field), kCulprit, ": ", key, " has ", field,
                    ", which a line to the device cannot have");
  }
}

void requireField(const char* key, const LineFormat& line, const char* field) {
  basics::require(line.has(field), kCulprit, ": ", key, " has no ", field);
}

bool keepsToSeparators(const std::string& text) {
  return !text.empty() && text.size() <= 4 &&
         text.find_first_of("0123456789+-.eE{}") == std::string::npos &&
         std::all_of(text.begin(), text.end(),
                     [](char c) { return (c >= ' ' && c <= '~') || c == '\t'; });
}

bool isBaud(int baud) {
  for (const int known : {1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 460800,
                          500000, 921600, 1000000, 2000000}) {
    if (baud == known) return true;
  }
  return false;
}

void validateLines(const SerialProfile& profile) {
  const SerialLines lines(profile);
  const char* const pressure = profile.one_by_one ? "{pressure}" : "{pressures}";
  requireField("write", *lines.write, pressure);
  requireField("reply", *lines.reply, pressure);
  requireSendable("write", *lines.write, {"{address}", pressure});
  if (lines.read) requireSendable("read", *lines.read, {"{address}"});
  for (const LineFormat& line : lines.start) requireSendable("start", line, {});
  const bool addressed = lines.write->has("{address}");
  const auto requireAlike = [&](const char* key, const LineFormat& line) {
    requireSendable(key, line, {"{address}"});
    basics::require(
        line.has("{address}") == addressed, kCulprit, ": ", key,
        addressed ? " has no {address}, but write has" : " has {address}, but write has none");
  };
  for (const LineFormat& line : lines.vent) requireAlike("vent", line);
  for (const LineFormat& line : lines.close) requireAlike("close", line);
  for (const LineFormat& line : lines.resume) requireAlike("resume", line);
  if (lines.read) requireAlike("read", *lines.read);
  basics::require(profile.one_by_one || !addressed, kCulprit,
                  ": write has {address}, but one_by_one is false");
  basics::require(profile.one_by_one || lines.close.empty(), kCulprit,
                  ": close is given, but one_by_one is false: one channel alone cannot be closed");
  if (lines.supply_line) requireField("supply_line", *lines.supply_line, "{supply}");
  const bool unasked = !lines.read;
  basics::require(
      !unasked || !profile.one_by_one, kCulprit,
      ": read is missing, so one_by_one must be false: unsolicited readings come in one "
      "line for all channels");
  basics::require(!unasked || (!lines.write_reply && !lines.vent_reply), kCulprit,
                  ": read is missing, so write_reply and vent_reply must be missing: unsolicited "
                  "lines answer nothing");
  basics::require(unasked || (!lines.supply_line && lines.skip.empty()), kCulprit,
                  ": supply_line and skip apply to unsolicited lines, but read is given");
}

}  // namespace

void SerialProfile::validate() const {
  require(isBaud(baud), "baud", baud, "a standard rate from 1200 to 2000000");
  basics::require(terminator == "\r" || terminator == "\n" || terminator == "\r\n", kCulprit,
                  ": terminator is \"", basics::quoted(terminator),
                  "\"; expected a carriage return, a line feed or both");
  require(pascals >= 1e-3 && pascals <= 1e8, "the size of the unit [Pa]", pascals, "1e-3 to 1e8");
  require(atmosphere >= 0 && atmosphere <= 2e5, "the atmosphere [Pa]", atmosphere, "0 to 2e5");
  require(decimals >= 0 && decimals <= 6, "decimals", decimals, "0 to 6");
  for (const std::string& text : {separator, reply_separator}) {
    basics::require(keepsToSeparators(text), kCulprit, ": a separator is \"", basics::quoted(text),
                    "\"; expected 1 to 4 characters that no number contains");
  }
  basics::require(std::all_of(unit_word.begin(), unit_word.end(),
                              [](char c) { return c > ' ' && c <= '~' && c != '{' && c != '}'; }),
                  kCulprit, ": unit_word is \"", basics::quoted(unit_word),
                  "\"; expected a word without spaces and braces");
  require(timeout >= 1e-3 && timeout <= 10, "timeout [s]", timeout, "0.001 to 10");
  require(watchdog >= std::max(0.1, 2 * timeout), "watchdog [s]", watchdog,
          "0.1 or more, and at least twice the timeout");
  require(highest > 0, "the highest pressure [Pa]", highest, "a value > 0");
  require(!channels || (*channels >= 1 && *channels <= kMostChannels), "channels",
          channels.value_or(0), "1 to 1024");
  basics::require(!write.empty(), kCulprit, ": write is missing");
  basics::require(!reply.empty(), kCulprit, ": reply is missing");
  basics::require(!vent.empty(), kCulprit,
                  ": vent is missing; a fault must be able to release the pressure");
  validateLines(*this);
}

SerialLines::SerialLines(const SerialProfile& profile) {
  const LineStyle sent{profile.separator, profile.unit_word, profile.decimals};
  const LineStyle received{profile.reply_separator, profile.unit_word, profile.decimals};
  start = formats("start", profile.start, sent);
  vent = formats("vent", profile.vent, sent);
  close = formats("close", profile.close, sent);
  resume = formats("resume", profile.resume, sent);
  skip = formats("skip", profile.skip, received);
  write = optionalFormat("write", profile.write, sent);
  read = optionalFormat("read", profile.read, sent);
  write_reply = optionalFormat("write_reply", profile.write_reply, received);
  reply = optionalFormat("reply", profile.reply, received);
  supply_line = optionalFormat("supply_line", profile.supply_line, received);
  vent_reply = optionalFormat("vent_reply", profile.vent_reply, received);
}

}  // namespace helix_arm::regulator
