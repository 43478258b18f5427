#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <limits>
#include <map>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace helix_arm::test {

/// One field of a ROS message, or the message: a value, an array, or a group of fields.
struct Field {
  enum class Kind { kValue, kText, kArray, kGroup };

  std::string path, type;  ///< "header.stamp", "time"
  Kind kind = Kind::kValue;
  bool fixed = false;  ///< an array of a fixed length
  std::string bytes;   ///< of a value or a text, without its length
  std::vector<Field> parts;
  std::optional<std::uint32_t> claim;  ///< the length that it tells instead of its own

  std::string written() const {
    std::string out;
    const auto length = [&out](std::size_t count) {
      const auto told = static_cast<std::uint32_t>(count);
      out.append(reinterpret_cast<const char*>(&told), sizeof told);
    };
    if (kind == Kind::kText) length(claim ? *claim : bytes.size());
    if (kind == Kind::kArray && !fixed) length(claim ? *claim : parts.size());
    out += bytes;
    for (const Field& part : parts) out += part.written();
    return out;
  }
};

/// The fields of the messages of a type, by its full definition, as a connection header has it.
class MessageFields {
 public:
  explicit MessageFields(const std::string& definition) {
    std::istringstream lines(definition);
    std::string type;
    for (std::string line; std::getline(lines, line);) {
      line = line.substr(0, line.find('#'));
      if (line.compare(0, 5, "=====") == 0) continue;
      if (line.compare(0, 5, "MSG: ") == 0) {
        type = line.substr(5);
        continue;
      }
      if (line.find('=') != std::string::npos) continue;  // a constant
      std::istringstream words(line);
      std::string of, name;
      if (words >> of >> name) types_[type].emplace_back(of, name);
    }
  }

  /// @throws std::runtime_error where the bytes are not of such a message.
  Field read(const std::string& bytes) const {
    Reader reader{bytes, 0};
    Field out = group("", "", reader);
    if (reader.at != bytes.size()) throw std::runtime_error("bytes are left over");
    return out;
  }

 private:
  struct Reader {
    const std::string& bytes;
    std::size_t at;
    std::string take(std::size_t count) {
      if (at + count > bytes.size()) throw std::runtime_error("the bytes end too early");
      at += count;
      return bytes.substr(at - count, count);
    }
    std::uint32_t length() {
      std::uint32_t out = 0;
      std::memcpy(&out, take(sizeof out).data(), sizeof out);
      return out;
    }
  };

  static std::size_t sizeOf(const std::string& type) {
    static const std::map<std::string, std::size_t> kSizes = {
        {"bool", 1},  {"int8", 1},   {"uint8", 1},   {"byte", 1},   {"char", 1},
        {"int16", 2}, {"uint16", 2}, {"int32", 4},   {"uint32", 4}, {"float32", 4},
        {"int64", 8}, {"uint64", 8}, {"float64", 8}, {"time", 8},   {"duration", 8}};
    const auto found = kSizes.find(type);
    return found == kSizes.end() ? 0 : found->second;
  }

  Field group(const std::string& type, const std::string& path, Reader& reader) const {
    Field out;
    out.path = path;
    out.type = type;
    out.kind = Field::Kind::kGroup;
    for (const auto& [of, name] : types_.at(type)) {
      out.parts.push_back(field(of, path.empty() ? name : path + "." + name, reader));
    }
    return out;
  }

  Field field(const std::string& type, const std::string& path, Reader& reader) const {
    Field out;
    out.path = path;
    out.type = type;
    if (const std::size_t bracket = type.find('['); bracket != std::string::npos) {
      out.kind = Field::Kind::kArray;
      out.fixed = type[bracket + 1] != ']';
      const std::uint32_t count =
          out.fixed ? static_cast<std::uint32_t>(std::stoul(type.substr(bracket + 1)))
                    : reader.length();
      const std::string of = type.substr(0, bracket);
      // Pictures and the like: one value of many bytes is enough.
      if (sizeOf(of) == 1) {
        out.kind = out.fixed ? Field::Kind::kValue : Field::Kind::kText;
        out.bytes = reader.take(count);
        return out;
      }
      for (std::uint32_t i = 0; i < count; ++i) {
        out.parts.push_back(field(of, path + "[" + std::to_string(i) + "]", reader));
      }
      return out;
    }
    if (type == "string") {
      out.kind = Field::Kind::kText;
      out.bytes = reader.take(reader.length());
    } else if (const std::size_t size = sizeOf(type); size > 0) {
      out.bytes = reader.take(size);
    } else {
      return group(fullName(type), path, reader);
    }
    return out;
  }

  std::string fullName(const std::string& type) const {
    if (types_.count(type) > 0) return type;
    for (const auto& entry : types_) {  // its package is left out, or it is the one Header
      const std::size_t slash = entry.first.find('/');
      if (slash != std::string::npos && entry.first.substr(slash + 1) == type) return entry.first;
    }
    throw std::runtime_error("no definition of " + type);
  }

  std::map<std::string, std::vector<std::pair<std::string, std::string>>> types_;
};

/// The extreme values of a value or text of this type, as bytes.
inline std::vector<std::string> extremesOf(const std::string& type) {
  std::vector<std::string> out;
  const auto add = [&out](auto... values) {
    std::string bytes;
    (bytes.append(reinterpret_cast<const char*>(&values), sizeof values), ...);
    out.push_back(bytes);
  };
  const auto numbers = [&](auto zero) {
    using Number = decltype(zero);
    using Limits = std::numeric_limits<Number>;
    for (const Number value : {Number(0), Limits::lowest(), Limits::max()}) add(value);
    if constexpr (!Limits::is_integer) {
      for (const Number value : {Limits::quiet_NaN(), Limits::infinity(), -Limits::infinity(),
                                 Limits::denorm_min(), Number(-0.0), Number(1e30)}) {
        add(value);
      }
    }
  };
  constexpr std::uint32_t kMost = std::numeric_limits<std::uint32_t>::max();
  if (type == "float64") numbers(0.0);
  if (type == "float32") numbers(0.0F);
  if (type == "int8" || type == "byte") numbers(std::int8_t{});
  if (type == "uint8" || type == "char" || type == "bool") numbers(std::uint8_t{});
  if (type == "int16") numbers(std::int16_t{});
  if (type == "uint16") numbers(std::uint16_t{});
  if (type == "int32") numbers(std::int32_t{});
  if (type == "uint32") numbers(std::uint32_t{});
  if (type == "int64") numbers(std::int64_t{});
  if (type == "uint64") numbers(std::uint64_t{});
  if (type == "time") {
    add(0U, 0U);
    add(0U, kMost);
    add(1U, 1000000000U);
    add(0x7fffffffU, 999999999U);
    add(0x80000000U, 0U);
    add(kMost, 0U);
    add(kMost, 999999999U);
    add(kMost, kMost);
  }
  if (type == "duration") {
    using Limits = std::numeric_limits<std::int32_t>;
    for (const std::int32_t s : {0, Limits::min(), Limits::max()}) {
      for (const std::int32_t ns : {0, Limits::min(), Limits::max()}) add(s, ns);
    }
  }
  if (type == "string") {
    out = {"",  std::string(3, '\0'),     "/", "\xff\xfe\x80\n%s%n%n", "../../etc/passwd",
           "0", std::string(1000000, 'x')};
  }
  if (type == "uint8[]") out = {"", "\xff\xd8\xff", std::string(1000000, '\xff')};
  return out;
}

/// Messages that differ from a sound one in one field, which is extreme; arrays in their length and
/// in their first and last part; then some in which every field is extreme, and some that end too
/// early.
/// @return what is extreme, and the bytes.
inline std::vector<std::pair<std::string, std::string>> extremesOf(const Field& sound) {
  std::vector<std::pair<std::string, std::string>> out;
  Field message = sound;
  const auto note = [&](const std::string& what) { out.emplace_back(what, message.written()); };
  const auto visit = [&](auto& self, Field& field) -> void {
    const Field before = field;
    if (field.kind == Field::Kind::kValue || field.kind == Field::Kind::kText) {
      int number = 0;
      for (const std::string& bytes : extremesOf(field.type)) {
        field.bytes = bytes;
        note(field.path + ", extreme " + std::to_string(number++));
      }
      field = before;
    }
    if (field.kind == Field::Kind::kText || (field.kind == Field::Kind::kArray && !field.fixed)) {
      for (const std::uint32_t claim : {1U << 29U, 0xffffffffU}) {
        field.claim = claim;
        note(field.path + " that claims " + std::to_string(claim));
      }
      field = before;
    }
    if (field.kind == Field::Kind::kArray && !field.fixed) {
      field.parts.clear();
      note(field.path + ", empty");
      field = before;
      if (!before.parts.empty()) {
        field.parts.pop_back();
        note(field.path + ", one less");
        field.parts.assign(before.parts.size() + 1, before.parts.front());
        note(field.path + ", one more");
        constexpr std::size_t kMostBytes = 2000000;
        field.parts.assign(
            std::min<std::size_t>(100000, kMostBytes / before.parts.front().written().size()),
            before.parts.front());
        note(field.path + ", huge");
        field = before;
      }
    }
    const bool array = field.kind == Field::Kind::kArray;
    for (std::size_t i = 0; i < field.parts.size(); ++i) {
      if (!array || i == 0 || i + 1 == field.parts.size()) self(self, field.parts[i]);
    }
  };
  visit(visit, message);
  for (std::size_t k = 0; k < 9; ++k) {
    const auto all = [&](auto& self, Field& field) -> void {
      const std::vector<std::string> extremes = extremesOf(field.type);
      if (field.parts.empty() && !extremes.empty()) field.bytes = extremes[k % extremes.size()];
      for (Field& part : field.parts) self(self, part);
    };
    message = sound;
    all(all, message);
    note("every field, extreme " + std::to_string(k));
  }
  const std::string bytes = sound.written();
  for (const std::size_t length : {std::size_t{0}, std::size_t{1}, bytes.size() / 2}) {
    out.emplace_back("cut to " + std::to_string(length) + " bytes", bytes.substr(0, length));
  }
  return out;
}

}  // namespace helix_arm::test
