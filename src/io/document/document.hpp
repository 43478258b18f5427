#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <istream>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/fault_list.hpp"

namespace helix_arm::io {

constexpr std::size_t kMostSceneBytes = 1U << 20U;   ///< of a scene or a profile
constexpr std::size_t kMostTableBytes = 64U << 20U;  ///< of a data set

/// The content of a regular text file; nothing, and a fault with the reason, if it cannot be read,
/// is not text or has more than `most` bytes.
std::optional<std::string> readTextFile(const std::string& path, std::size_t most,
                                        FaultList& faults);
/// The same of a stream, to its end.
std::optional<std::string> readTextStream(std::istream& in, std::size_t most, FaultList& faults);

/// Where a value comes from: a line of the file, or an override.
struct Place {
  int line = 0;                             ///< counted from 1; 0 in an override
  std::optional<std::string> override_key;  ///< key of `--set`; absent if it is from the file
};

/// A value of a YAML document as a plain tree with its order, places and quotes.
struct Value {
  enum class Kind { kEmpty, kText, kList, kMap };
  struct Entry;

  Kind kind = Kind::kEmpty;
  std::string text;            ///< kText
  bool quoted = false;         ///< kText: quoted, hence never a number
  std::vector<Entry> entries;  ///< kList and kMap
  Place place;

  /// The value of a map's key, null if there is none.
  const Value* find(const std::string& key) const;
  /// Name in messages: its text (printable, 60 letters at most), "a list", "a map" or "empty".
  std::string describe() const;
};

struct Value::Entry {
  std::string key;  ///< empty in a list
  Value value;
};

/// Adds a fault at a place: its concatenated parts.
template <class... Parts>
void report(FaultList& faults, const Place& place, const Parts&... fault) {
  const std::string from = place.override_key ? "--set " + *place.override_key + ": " : "";
  faults.add(place.line, basics::messageOf(from, fault...));
}

/// `parent.key`, or the key alone at the top.
std::string joinPath(const std::string& parent, const std::string& key);
/// Name of a path in messages; "the document" for the empty path.
std::string nameOf(const std::string& path);
/// `parent[index]`.
std::string indexPath(const std::string& parent, std::size_t index);

/// How our documents are recognised. Messages do not repeat the content of other documents.
struct DocumentKind {
  std::vector<std::string> keys;     ///< at its top
  std::vector<std::string> telling;  ///< keys that other documents are unlikely to have
  std::size_t needed = 0;            ///< number of these needed; 0: any document is accepted
};

/// Reads one YAML document. Syntax errors, repeated keys, keys that are not words, and texts that
/// are not printable (basics::printable(), besides tabs and line ends in values) are faults. A
/// document of another kind is one fault, which does not repeat its content.
/// @return nothing if there is no usable tree.
std::optional<Value> parseDocument(const std::string& text, const DocumentKind& kind,
                                   FaultList& faults);

/// Applies an override to the tree, creating missing maps. The schema checks its keys later.
void applyOverride(Value& document, const Override& change, FaultList& faults);

/// The YAML text of a tree; parsing it gives the same tree, except for its places.
std::string writeDocument(const Value& document);

/// A value that is written unquoted: a number, true, a word.
Value plainValue(const std::string& text);
/// The shortest text that reads back as the same number.
Value numberValue(double number);
Value numbersValue(const Eigen::VectorXd& numbers);
Value listValue(const std::vector<Value>& values);

/// The mutable value of a map's key, null if there is none.
Value* findValue(Value& map, const std::string& key);
/// Replaces the value of a key, or appends the key.
void setValue(Value& map, const std::string& key, Value value);
void eraseValue(Value& map, const std::string& key);

}  // namespace helix_arm::io
