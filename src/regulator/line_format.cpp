#include "line_format.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <stdexcept>

#include "basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/regulator/config.hpp"
#include "serial_port.hpp"

namespace helix_arm::regulator {
namespace {

constexpr double kHighestNumber = 1e9;   // times 10^6 is still exact
constexpr std::size_t kMostDigits = 15;  // a double represents any of them exactly
constexpr int kHighestExponent = 22;     // and 10 to any power up to this
constexpr double kPowersOfTen[kHighestExponent + 1] = {
    1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
    1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

bool isBlank(char c) { return c == ' ' || c == '\t'; }
bool isDigit(char c) { return c >= '0' && c <= '9'; }
bool isLetter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); }
bool isPrintable(char c) { return (c >= ' ' && c <= '~') || c == '\t'; }
bool isEnd(char c) { return isBlank(c) || c == '\r' || c == '\n'; }

std::string_view withoutEnds(std::string_view line) {
  while (!line.empty() && isEnd(line.back())) line.remove_suffix(1);
  while (!line.empty() && isEnd(line.front())) line.remove_prefix(1);
  return line;
}

std::string numberText(double value, int decimals) {
  if (!std::isfinite(value)) return "nan";
  basics::require(std::abs(value) < kHighestNumber, "a line cannot hold the number ", value,
                  "; expected one below 1e9");
  const auto scale = static_cast<std::int64_t>(kPowersOfTen[decimals]);
  const std::int64_t counts = std::llround(value * static_cast<double>(scale));
  const std::int64_t size = std::abs(counts);
  std::string text = (counts < 0 ? "-" : "") + std::to_string(size / scale);
  if (decimals == 0) return text;
  const std::string fraction = std::to_string(size % scale);
  return text + "." + std::string(static_cast<std::size_t>(decimals) - fraction.size(), '0') +
         fraction;
}

constexpr const char* kFields[] = {"{address}",   "{pressure}", "{pressures}",
                                   "{set_point}", "{supply}",   "{unit}",
                                   "{*}",         "{words}",    "{...}"};
bool isField(const std::string& part) { return part[0] == '{'; }

constexpr const char* kCulprit = "serial profile";
constexpr int kMostChannels = 1024;

template <class Value>
void require(bool holds, const char* key, const Value& value, const char* rule) {
  basics::requireValue(holds, kCulprit, key, value, rule);
}

// @throws std::invalid_argument naming the key and the fault in its line.
std::vector<LineFormat> formats(const char* key, const std::vector<std::string>& texts,
                                const LineStyle& style) {
  std::vector<LineFormat> lines;
  try {
    for (const std::string& text : texts) lines.emplace_back(text, style);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(std::string(kCulprit) + ": " + key + " " + error.what());
  }
  return lines;
}

std::optional<LineFormat> optionalFormat(const char* key, const std::string& text,
                                         const LineStyle& style) {
  return text.empty() ? std::nullopt : std::optional(formats(key, {text}, style).front());
}

// A line to the device must not have fields that cannot be filled in.
void requireSendable(const char* key, const LineFormat& line,
                     std::initializer_list<const char*> allowed) {
  for (const std::string_view field : kFields) {
    const bool known = std::count(allowed.begin(), allowed.end(), field) > 0 || field == "{unit}";
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
         std::all_of(text.begin(), text.end(), isPrintable);
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
  if (lines.unit_query) requireAlike("unit_query", *lines.unit_query);
  if (lines.unit_reply) requireField("unit_reply", *lines.unit_reply, "{unit}");
  basics::require(profile.unit_query.empty() == profile.unit_reply.empty(), kCulprit,
                  ": unit_query or unit_reply is missing; expected both or neither");
  if (lines.supply_line) requireField("supply_line", *lines.supply_line, "{supply}");
  const bool unasked = !lines.read;
  basics::require(
      !unasked || !profile.one_by_one, kCulprit,
      ": read is missing, so one_by_one must be false: unsolicited readings come in one "
      "line for all channels");
  basics::require(!unasked || (!lines.write_reply && !lines.vent_reply), kCulprit,
                  ": read is missing, so write_reply and vent_reply must be missing: unsolicited "
                  "lines answer nothing");
  basics::require(!unasked || !lines.unit_query, kCulprit,
                  ": unit_query is given, but read is missing: the device answers nothing");
  basics::require(unasked || (!lines.supply_line && lines.skip.empty()), kCulprit,
                  ": supply_line and skip apply to unsolicited lines, but read is given");
}

}  // namespace

std::string withChecksum(const std::string& line) {
  constexpr unsigned kPolynomial = 0x1021;
  unsigned crc = 0xFFFF;
  for (const char c : line) {
    crc ^= static_cast<unsigned>(static_cast<unsigned char>(c)) << 8U;
    for (int bit = 0; bit < 8; ++bit) {
      crc = ((crc << 1U) ^ ((crc & 0x8000U) != 0 ? kPolynomial : 0U)) & 0xFFFFU;
    }
  }
  std::string checked = line + '*';
  for (const unsigned shift : {12U, 8U, 4U, 0U}) checked += "0123456789ABCDEF"[crc >> shift & 0xFU];
  return checked;
}

std::optional<std::string> withoutChecksum(std::string_view line) {
  constexpr std::size_t kSize = 5;  // "*" and four digits
  while (!line.empty() && isEnd(line.back())) line.remove_suffix(1);
  if (line.size() < kSize) return std::nullopt;
  std::string inner(line.substr(0, line.size() - kSize));
  if (withChecksum(inner) != line) return std::nullopt;
  return inner;
}

// Reads one line from left to right.
class LineFormat::Reader {
 public:
  explicit Reader(std::string_view line) : line_(line) {}

  std::size_t at() const { return at_; }
  bool done() const { return at_ == line_.size(); }
  char next() const { return done() ? '\0' : line_[at_]; }

  // Takes one part of a template. @return what was expected; empty if the line matches.
  std::string take(const std::string& part, const std::string& following, const LineStyle& style,
                   const std::string& address, std::size_t pressures, LineFields& fields) {
    if (part == "{address}") return skip(address) ? "" : "the address " + address;
    if (part == "{pressure}") return takePressures(1, style.separator, fields);
    if (part == "{pressures}") return takePressures(pressures, style.separator, fields);
    if (part == "{set_point}") return (fields.set_point = number()) ? "" : "a number";
    if (part == "{supply}") return (fields.supply = number()) ? "" : "a number";
    if (part == "{unit}") {
      if (!skip(style.unit_word)) return "the unit " + style.unit_word;
      return isLetter(next()) ? "the end of the unit " + style.unit_word : "";
    }
    if (part == "{*}") {
      return skipWord(isField(following) || isBlank(following[0]) ? '\0' : following[0]) ? ""
                                                                                         : "a word";
    }
    if (part == "{words}") return skipWords() ? "" : "words of letters, or the end";
    if (part == "{...}") {
      at_ = line_.size();
      return "";
    }
    if (isBlank(part[0])) return skipBlanks() ? "" : "a blank";
    return skip(part) ? "" : "\"" + part + "\"";
  }

 private:
  std::string takePressures(std::size_t count, const std::string& separator, LineFields& fields) {
    const bool blank = std::all_of(separator.begin(), separator.end(), isBlank);
    for (std::size_t k = 0; k < count; ++k) {
      if (k > 0 && !(blank ? skipBlanks() : skip(separator))) {
        return std::to_string(count) + " pressures, not " + std::to_string(k);
      }
      const std::optional<double> value = number();
      if (!value) return "a number";
      fields.pressures.push_back(*value);
    }
    return "";
  }

  bool skip(std::string_view text) {
    if (line_.compare(at_, text.size(), text) != 0) return false;
    at_ += text.size();
    return true;
  }
  bool skipBlanks() {
    const std::size_t begin = at_;
    while (isBlank(next())) ++at_;
    return at_ > begin;
  }
  bool skipWord(char end) {
    const std::size_t begin = at_;
    while (!done() && !isBlank(next()) && (end == '\0' || next() != end)) ++at_;
    return at_ > begin;
  }
  bool skipWords() {
    while (!done()) {
      if (!skipBlanks() || !isLetter(next())) return false;
      while (isLetter(next())) ++at_;
    }
    return true;
  }

  std::optional<double> number() {
    const std::size_t begin = at_;
    const std::optional<double> value = numberHere();
    if (!value) at_ = begin;
    return value;
  }

  std::optional<double> numberHere() {
    const bool negative = next() == '-';
    if (negative || next() == '+') ++at_;
    std::uint64_t mantissa = 0;
    std::size_t significant = 0, digits = 0;
    int exponent = 0;
    const auto takeDigits = [&](int shift) {
      for (; isDigit(next()); ++at_, ++digits) {
        if (significant > 0 || next() != '0') ++significant;
        if (significant > kMostDigits) return false;
        mantissa = mantissa * 10 + static_cast<std::uint64_t>(next() - '0');
        exponent -= shift;
      }
      return true;
    };
    if (!takeDigits(0)) return std::nullopt;
    if (next() == '.') {
      ++at_;
      if (!takeDigits(1)) return std::nullopt;
    }
    if (digits == 0 || digits > 2 * kMostDigits) return std::nullopt;
    if ((next() == 'e' || next() == 'E') && !takeExponent(exponent)) return std::nullopt;
    if (std::abs(exponent) > kHighestExponent) return std::nullopt;
    const auto whole = static_cast<double>(mantissa);
    const double size =
        exponent < 0 ? whole / kPowersOfTen[-exponent] : whole * kPowersOfTen[exponent];
    return negative ? -size : size;
  }

  bool takeExponent(int& exponent) {
    ++at_;
    const bool negative = next() == '-';
    if (negative || next() == '+') ++at_;
    if (!isDigit(next())) return false;
    int value = 0;
    for (; isDigit(next()); ++at_) value = std::min(value * 10 + (next() - '0'), 1000);
    exponent += negative ? -value : value;
    return true;
  }

  std::string_view line_;
  std::size_t at_ = 0;
};

LineFormat::LineFormat(const std::string& text, LineStyle style)
    : text_(text), style_(std::move(style)) {
  demand(!text_.empty(), "is empty; expected a line of text");
  demand(text_.size() <= kLongestLine, "is longer than 512 bytes");
  demand(std::all_of(text_.begin(), text_.end(), isPrintable),
         "has a byte that is neither printable ASCII nor a tab");
  demand(!isBlank(text_.front()) && !isBlank(text_.back()),
         "begins or ends with a blank; expected none, since they are ignored there");
  demand(style_.decimals >= 0 && style_.decimals <= 6,
         "has numbers of more than 6 decimals; expected 0 to 6");
  for (std::size_t at = 0; at < text_.size();) {
    const std::size_t begin = at;
    if (isBlank(text_[at])) {
      while (isBlank(text_[at])) ++at;
      parts_.push_back(text_.substr(begin, at - begin));
    } else if (text_[at] == '{') {
      at = text_.find('}', at);
      demand(at != std::string::npos, "has a { without a }");
      const std::string field = text_.substr(begin, ++at - begin);
      demand(std::count(std::begin(kFields), std::end(kFields), field) > 0,
             "has " + basics::quoted(field) +
                 "; expected {address}, {pressure}, {pressures}, {set_point}, {supply}, {unit}, "
                 "{*}, {words} or {...}");
      parts_.push_back(field);
    } else {
      at = std::min(text_.find_first_of("{ \t", at), text_.size());
      parts_.push_back(text_.substr(begin, at - begin));
      demand(parts_.back().find('}') == std::string::npos, "has a } without a {");
    }
  }
  checkFields();
}

void LineFormat::demand(bool holds, const std::string& fault) const {
  basics::require(holds, "\"", basics::quoted(text_), "\" ", fault);
}

void LineFormat::checkFields() const {
  bool after_value = false;
  for (const std::string& part : parts_) {
    const bool tail = part == "{words}" || part == "{...}";
    demand(!tail || &part == &parts_.back(), "has " + part + " before its end");
    demand(!isField(part) || tail || !after_value,
           "has nothing before " + part + " to separate it from the previous field");
    after_value = isField(part);
    demand(!isField(part) || part == "{*}" || text_.find(part) == text_.rfind(part),
           "has " + part + " twice");
  }
  demand(!(has("{pressure}") && has("{pressures}")), "has both {pressure} and {pressures}");
  demand(!has("{unit}") || !style_.unit_word.empty(), "has {unit}, but unit_word is missing");
}

bool LineFormat::has(std::string_view field) const {
  return std::find(parts_.begin(), parts_.end(), field) != parts_.end();
}

std::string LineFormat::line(const std::string& address, const LineFields& fields) const {
  const auto number = [&](const std::optional<double>& value, const std::string& part) {
    basics::require(value.has_value(), "\"", basics::quoted(text_), "\" needs ", part,
                    ", which is not given");
    return numberText(*value, style_.decimals);
  };
  const std::vector<double>& pressures = fields.pressures;
  std::string line;
  for (const std::string& part : parts_) {
    if (part == "{address}") {
      line += address;
    } else if (part == "{pressure}") {
      line += number(pressures.size() == 1 ? std::optional(pressures[0]) : std::nullopt, part);
    } else if (part == "{pressures}") {
      for (std::size_t i = 0; i < pressures.size(); ++i) {
        line += (i == 0 ? "" : style_.separator) + number(pressures[i], part);
      }
    } else if (part == "{set_point}" || part == "{supply}") {
      line += number(part == "{supply}" ? fields.supply : fields.set_point, part);
    } else if (part == "{unit}") {
      line += style_.unit_word;
    } else if (part == "{*}") {
      line += "0";
    } else if (!isField(part)) {
      line += part;
    }
  }
  return line;
}

std::optional<LineFields> LineFormat::read(std::string_view line, const std::string& address,
                                           std::size_t pressures, Mismatch& mismatch) const {
  const auto miss = [&mismatch](std::size_t at, std::string expected) {
    mismatch = {at, std::move(expected)};
    return std::nullopt;
  };
  if (line.size() > kLongestLine) return miss(0, "a line of at most 512 bytes");
  const auto bad = std::find_if_not(line.begin(), line.end(), isPrintable);
  if (bad != line.end()) {
    return miss(static_cast<std::size_t>(bad - line.begin()), "printable ASCII");
  }
  Reader reader(line);
  LineFields fields;
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    const std::string following = i + 1 < parts_.size() ? parts_[i + 1] : "";
    std::string expected = reader.take(parts_[i], following, style_, address, pressures, fields);
    if (!expected.empty()) return miss(reader.at(), std::move(expected));
  }
  if (!reader.done()) return miss(reader.at(), "the end");
  return fields;
}

std::optional<LineFields> LineFormat::match(std::string_view line, const std::string& address,
                                            std::size_t pressures) const {
  Mismatch mismatch;
  return read(withoutEnds(line), address, pressures, mismatch);
}

LineFields LineFormat::parse(std::string_view line, const std::string& address,
                             std::size_t pressures) const {
  const std::string_view inner = withoutEnds(line);
  Mismatch mismatch;
  if (std::optional<LineFields> fields = read(inner, address, pressures, mismatch)) {
    return std::move(*fields);
  }
  const std::string rest(inner.substr(mismatch.at));
  throw BadReply("\"" + basics::quoted(std::string(inner)) + "\" does not match \"" +
                 basics::quoted(text_) + "\": expected " + mismatch.expected +
                 (rest.empty() ? " at its end" : " at \"" + basics::quoted(rest, 16) + "\""));
}

void SerialProfile::validate() const {
  require(isStandardBaud(baud), "baud", baud, "a standard rate from 1200 to 2000000");
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
  unit_query = optionalFormat("unit_query", profile.unit_query, sent);
  unit_reply = optionalFormat("unit_reply", profile.unit_reply, received);
}

}  // namespace helix_arm::regulator
