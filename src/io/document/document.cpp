#include "document.hpp"

#include <algorithm>
#include <set>
#include <sstream>
#include <utility>

#include <yaml-cpp/yaml.h>

#include "basics/quote.hpp"
#include "basics/regular_file.hpp"
#include "map_reader.hpp"
#include "number.hpp"

namespace helix_arm::io {
namespace {

std::optional<std::string> plainText(std::string text, FaultList& faults) {
  const auto binary = std::find_if(text.begin(), text.end(), [](char c) {
    return static_cast<unsigned char>(c) < 0x20 && c != '\t' && c != '\n' && c != '\r';
  });
  if (binary == text.end()) return text;
  const auto line = std::count(text.begin(), binary, '\n') + 1;
  faults.add(static_cast<int>(line), "holds a control character; expected a text file");
  return std::nullopt;
}

// With aliases, a short file may expand to an endless tree, or to many copies of a long text.
constexpr std::size_t kMostBytes = kMostSceneBytes;
constexpr int kMostValues = 20000;
constexpr int kDeepest = 50;

struct TooLarge {};

// Names and paths end at a NUL, and terminals obey control characters.
// @param spaces  control characters that are accepted.
bool isPrintable(std::string text, const std::string& spaces) {
  const auto is_space = [&](char c) { return spaces.find(c) != std::string::npos; };
  text.erase(std::remove_if(text.begin(), text.end(), is_space), text.end());
  return basics::printable(text) == text;
}

constexpr char kNotPrintable[] = "a control character, or bytes that are not UTF-8";

// The line, from 1, in which a second document begins, which YAML::Load would ignore; 0 if there is
// none. YAML::LoadAll does not return from a stray `,` at the begin of a document.
int secondDocument(const std::string& text) {
  std::istringstream lines(text);
  std::string line;
  bool begun = false;
  for (int number = 1; std::getline(lines, line); ++number) {
    const bool begins = line.compare(0, 3, "---") == 0 && (line + " ").find_first_of(" \t\r") == 3;
    if (begins && begun) return number;
    const std::size_t content = line.find_first_not_of(" \t\r");
    begun = begun || begins ||
            (content != std::string::npos && line[content] != '#' && line[content] != '%');
  }
  return 0;
}

struct Conversion {
  FaultList& faults;
  std::optional<std::string> override_key;
  int values = 0;
  std::size_t bytes = 0;
  bool is_text = true;  // what readers may look at

  void count() {
    if (++values > kMostValues) throw TooLarge();
  }

  Place place(const YAML::Mark& mark, const Place& fallback) const {
    if (override_key) return {0, override_key};
    return mark.is_null() ? fallback : Place{mark.line + 1, {}};
  }

  Value convert(const YAML::Node& node, const std::string& path, const Place& key_place,
                int depth) {
    Value value;
    value.place = key_place;
    count();
    if (depth > kDeepest) throw TooLarge();
    if (node.IsScalar()) {
      value.kind = Value::Kind::kText;
      value.text = node.Scalar();
      if ((bytes += value.text.size()) > kMostBytes) throw TooLarge();
      if (!isPrintable(value.text, "\t\n\r")) {
        is_text = false;
        report(faults, place(node.Mark(), key_place), nameOf(path), " holds ", kNotPrintable,
               "; expected printable text in UTF-8");
      }
      value.quoted = node.Tag() == "!";
      value.place = place(node.Mark(), key_place);
    } else if (node.IsSequence()) {
      value.kind = Value::Kind::kList;
      for (std::size_t i = 0; i < node.size(); ++i) {
        const Place here = place(node[i].Mark(), key_place);
        value.entries.push_back({{}, convert(node[i], indexPath(path, i), here, depth + 1)});
      }
    } else if (node.IsMap()) {
      value.kind = Value::Kind::kMap;
      std::set<std::string> names;
      for (const auto& pair : node) addEntry(value, names, pair.first, pair.second, path, depth);
    }
    return value;
  }

  void addEntry(Value& map, std::set<std::string>& names, const YAML::Node& key,
                const YAML::Node& node, const std::string& path, int depth) {
    const Place here = place(key.Mark(), map.place);
    count();  // omitted ones, too
    if (!key.IsScalar()) {
      return report(faults, here, nameOf(path), " has a key that is not a word; expected a name");
    }
    const std::string& name = key.Scalar();
    if (!isPrintable(name, "")) {
      is_text = false;
      return report(faults, here, nameOf(path), " has a key with ", kNotPrintable,
                    "; expected a name of printable text");
    }
    if (!names.insert(name).second) {
      return report(faults, here, joinPath(path, name), " is given twice; expected it once");
    }
    map.entries.push_back({name, convert(node, joinPath(path, name), here, depth + 1)});
  }
};

// The first line of a text, from 1, that begins with a tab, perhaps after blanks; 0 if none does.
int tabbedLine(const std::string& text) {
  std::istringstream lines(text);
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    const std::size_t begin = line.find_first_not_of(' ');
    if (begin != std::string::npos && line[begin] == '\t') return number;
  }
  return 0;
}

// Without the context that yaml-cpp appends to some messages.
std::string reasonOf(const YAML::Exception& error) {
  const std::string unknown_anchor = YAML::ErrorMsg::UNKNOWN_ANCHOR;
  if (error.msg.compare(0, unknown_anchor.size(), unknown_anchor) == 0) return unknown_anchor;
  return error.msg.substr(0, error.msg.find(": "));
}

std::optional<Value> parse(const std::string& text, const std::optional<std::string>& override_key,
                           const std::string& path, FaultList& faults) {
  const Place start{override_key ? 0 : 1, override_key};
  try {
    if (text.size() > kMostBytes) throw TooLarge();
    if (const int line = secondDocument(text); line > 0) {
      report(faults, override_key ? start : Place{line, {}},
             "begins a second document; expected only one");
      return std::nullopt;
    }
    // A failed conversion reports the faults that were found before it.
    FaultList found = faults.ofSameFile();
    Conversion conversion{found, override_key};
    Value document = conversion.convert(YAML::Load(text), path, start, 0);
    faults.append(found);
    if (!conversion.is_text) return std::nullopt;
    return document;
  } catch (const TooLarge&) {
    report(faults, start, "is nested too deeply or holds too many values");
  } catch (const YAML::Exception& error) {
    const Place place{error.mark.is_null() ? start.line : error.mark.line + 1, {}};
    const int tabbed = override_key ? 0 : tabbedLine(text);
    report(faults, override_key ? start : place, "is not YAML: " + reasonOf(error),
           tabbed == 0 ? ""
                       : "; line " + std::to_string(tabbed) +
                             " begins with a tab, which cannot indent YAML: use blanks");
  }
  return std::nullopt;
}

// The parts of `arm.sections.0.name`, or of `arm.sections[0].name`, as messages write it.
std::vector<std::string> splitKey(const std::string& key) {
  std::vector<std::string> parts(1);
  for (const char c : key) {
    if (c == '.' || c == '[') {
      parts.emplace_back();
    } else if (c != ']') {
      parts.back() += c;
    }
  }
  return parts;
}

bool isFlat(const Value& list) {
  return std::none_of(list.entries.begin(), list.entries.end(), [](const Value::Entry& entry) {
    return entry.value.kind == Value::Kind::kList || entry.value.kind == Value::Kind::kMap;
  });
}

void emit(const Value& value, YAML::Emitter& out) {
  switch (value.kind) {
    case Value::Kind::kEmpty:
      out << YAML::Null;
      break;
    case Value::Kind::kText:
      if (value.quoted) out << YAML::DoubleQuoted;
      out << value.text;
      break;
    case Value::Kind::kList:
      if (isFlat(value)) out << YAML::Flow;
      out << YAML::BeginSeq;
      for (const Value::Entry& entry : value.entries) emit(entry.value, out);
      out << YAML::EndSeq;
      break;
    case Value::Kind::kMap:
      out << YAML::BeginMap;
      for (const Value::Entry& entry : value.entries) {
        out << YAML::Key << entry.key << YAML::Value;
        emit(entry.value, out);
      }
      out << YAML::EndMap;
      break;
  }
}

}  // namespace

std::optional<std::string> readTextFile(const std::string& path, std::size_t most,
                                        FaultList& faults) {
  basics::RegularFile file(path);
  std::optional<std::string> text = file.readAll(most);
  if (!text) {
    faults.add(0, file.fault() + (file.isOpen() ? "; expected a text file" : ""));
    return std::nullopt;
  }
  return plainText(std::move(*text), faults);
}

std::optional<std::string> readTextStream(std::istream& in, std::size_t most, FaultList& faults) {
  std::string text(most + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(in.gcount()));
  if (text.size() > most) {
    faults.add(0, "has more than " + std::to_string(most) + " bytes; expected at most that");
    return std::nullopt;
  }
  return plainText(std::move(text), faults);
}

const Value* Value::find(const std::string& key) const {
  const auto found = std::find_if(entries.begin(), entries.end(),
                                  [&key](const Entry& entry) { return entry.key == key; });
  return kind == Kind::kMap && found != entries.end() ? &found->value : nullptr;
}

std::string Value::describe() const {
  constexpr std::size_t kLongest = 60;
  switch (kind) {
    case Kind::kList:
      return "a list";
    case Kind::kMap:
      return "a map";
    case Kind::kText:
      return quoted ? '"' + basics::quoted(text, kLongest) + '"' : basics::quoted(text, kLongest);
    case Kind::kEmpty:
      break;
  }
  return "empty";
}

std::string joinPath(const std::string& parent, const std::string& key) {
  if (parent.empty() || key.empty()) return parent + key;
  return parent + "." + key;
}

std::string nameOf(const std::string& path) { return path.empty() ? "the document" : path; }

std::string indexPath(const std::string& parent, std::size_t index) {
  return parent + "[" + std::to_string(index) + "]";
}

std::optional<Value> parseDocument(const std::string& text, const DocumentKind& kind,
                                   FaultList& faults) {
  FaultList found = faults.ofSameFile();
  std::optional<Value> document = parse(text, std::nullopt, {}, found);
  const auto isThere = [&](const std::string& key) { return document->find(key) != nullptr; };
  if (!document || static_cast<std::size_t>(std::count_if(kind.telling.begin(), kind.telling.end(),
                                                          isThere)) >= kind.needed) {
    faults.append(found);
    return document;
  }
  const bool is_text = document->kind == Value::Kind::kText;
  report(faults, document->place, "the document is ", is_text ? "a text" : document->describe(),
         document->kind == Value::Kind::kMap ? " of other keys" : "", "; expected a map of ",
         alternatives(kind.keys));
  return std::nullopt;
}

void applyOverride(Value& document, const Override& change, FaultList& faults) {
  const Place place{0, change.key};
  std::optional<Value> value = parse(change.value, change.key, change.key, faults);
  if (!value) return;
  Value* target = &document;
  std::string path;
  for (const std::string& part : splitKey(change.key)) {
    if (part.empty()) {
      return report(faults, place, "is not a key; expected words and numbers separated by dots");
    }
    if (target->kind == Value::Kind::kList) {
      std::size_t index = 0;
      while (index < target->entries.size() && part != std::to_string(index)) ++index;
      if (index == target->entries.size()) {
        return report(faults, place, nameOf(path), " has ", target->entries.size(),
                      " entries; expected an index from 0, not ", part);
      }
      target = &target->entries[index].value;
      path += "[" + part + "]";
    } else if (target->kind == Value::Kind::kText) {
      return report(faults, place, nameOf(path), " is ", target->describe(),
                    "; expected a map or a list");
    } else {
      target->kind = Value::Kind::kMap;
      if (findValue(*target, part) == nullptr) {
        target->entries.push_back({part, {Value::Kind::kMap, {}, false, {}, place}});
      }
      target = findValue(*target, part);
      path = joinPath(path, part);
    }
  }
  *target = std::move(*value);
}

std::string writeDocument(const Value& document) {
  YAML::Emitter out;
  emit(document, out);
  return std::string(out.c_str()) + "\n";
}

Value plainValue(const std::string& text) { return {Value::Kind::kText, text, false, {}, {}}; }

std::string yamlText(const std::string& text) {
  std::string out = writeDocument(plainValue(text));
  out.pop_back();  // the end of the line
  return out;
}

Value numberValue(double number) { return plainValue(formatNumber(number)); }

Value numbersValue(const Eigen::VectorXd& numbers) {
  std::vector<Value> values;
  for (const double number : numbers) values.push_back(numberValue(number));
  return listValue(values);
}

Value listValue(const std::vector<Value>& values) {
  Value list{Value::Kind::kList, {}, false, {}, {}};
  for (const Value& value : values) list.entries.push_back({{}, value});
  return list;
}

Value* findValue(Value& map, const std::string& key) { return const_cast<Value*>(map.find(key)); }

void setValue(Value& map, const std::string& key, Value value) {
  if (Value* present = findValue(map, key)) {
    *present = std::move(value);
  } else {
    map.entries.push_back({key, std::move(value)});
  }
}

void eraseValue(Value& map, const std::string& key) {
  map.entries.erase(std::remove_if(map.entries.begin(), map.entries.end(),
                                   [&key](const Value::Entry& entry) { return entry.key == key; }),
                    map.entries.end());
}

}  // namespace helix_arm::io
