#pragma once

#include <optional>
#include <string>
#include <vector>

#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/override.hpp"

namespace helix_arm::io {

/// Where something was written: a line of the file, or an override.
struct Place {
  int line = 0;                             ///< counted from 1; 0 in an override
  std::optional<std::string> override_key;  ///< of `--set`; absent where the file says it
};

/// A value of a YAML document as a plain tree: it keeps the order, the places and the quotes.
struct Value {
  enum class Kind { kEmpty, kText, kList, kMap };
  struct Entry;

  Kind kind = Kind::kEmpty;
  std::string text;            ///< kText
  bool quoted = false;         ///< kText: never a number, whatever it looks like
  std::vector<Entry> entries;  ///< kList and kMap
  Place place;

  /// The value of a map's key, null when there is none.
  const Value* find(const std::string& key) const;
  /// How a message names it: its text (printable, 60 letters at most), "a list", "a map" or
  /// "empty".
  std::string describe() const;
};

struct Value::Entry {
  std::string key;  ///< empty in a list
  Value value;
};

/// Adds a fault at a place.
void report(FaultList& faults, const Place& place, const std::string& fault);

/// `parent.key`, or the key alone at the top.
std::string joinPath(const std::string& parent, const std::string& key);
/// How a message names a path: the top has none.
std::string nameOf(const std::string& path);
/// `parent[index]`.
std::string indexPath(const std::string& parent, std::size_t index);

/// How a document of ours is told from any other that somebody names, whose words no message
/// repeats.
struct DocumentKind {
  std::vector<std::string> keys;     ///< at its top
  std::vector<std::string> telling;  ///< those of them that no other document is likely to have
  std::size_t needed = 0;            ///< of the telling ones; 0: any document will do
};

/// Reads one YAML document. Syntax errors, repeated keys and keys that are no words go to the
/// faults. A document of another kind is one fault, which holds nothing of it.
/// @return nothing where there is no tree to go on with.
std::optional<Value> parseDocument(const std::string& text, const DocumentKind& kind,
                                   FaultList& faults);

/// Puts an override into the tree, making the maps on its way that are not there yet; whether its
/// keys mean anything is for the schema to say.
void applyOverride(Value& document, const Override& change, FaultList& faults);

/// The YAML text of a tree; parsing it gives the tree again, but for its places.
std::string writeDocument(const Value& document);

}  // namespace helix_arm::io
