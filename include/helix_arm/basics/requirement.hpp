#pragma once

#include <cmath>
#include <initializer_list>
#include <sstream>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>

namespace helix_arm::basics {

/// Writes a part of a message; whatever the sign of a NaN, it is "nan".
template <class Part>
void writePart(std::ostream& out, const Part& part) {
  if constexpr (std::is_floating_point_v<Part>) {
    if (std::isnan(part)) {
      out << "nan";
      return;
    }
  }
  out << part;
}

/// The concatenated parts of a message.
template <class... Parts>
std::string messageOf(const Parts&... parts) {
  std::ostringstream text;
  (writePart(text, parts), ...);
  return text.str();
}

/// @throws std::invalid_argument with the concatenated message parts unless `holds`.
template <class... Parts>
void require(bool holds, const Parts&... message) {
  if (!holds) throw std::invalid_argument(messageOf(message...));
}

/// A broken rule of a key; what() is "key: rule".
struct Requirement : std::invalid_argument {
  Requirement(const std::string& broken_key, const std::string& broken_rule)
      : std::invalid_argument(broken_key + ": " + broken_rule),
        key(broken_key),
        rule(broken_rule) {}

  std::string key;   ///< dotted, of a scene or of what else is checked: load.points
  std::string rule;  ///< what is wrong, and the remedy
};

/// @throws Requirement with the concatenated parts of the rule unless `holds`.
template <class... Parts>
void requireKey(bool holds, const char* key, const Parts&... rule) {
  if (!holds) throw Requirement(key, messageOf(rule...));
}

/// @throws Requirement "<culprit>: <what> is <value>; expected <rule>" unless `holds`.
template <class Value, class Rule>
void requireValue(bool holds, const char* culprit, const char* what, const Value& value,
                  const Rule& rule) {
  requireKey(holds, culprit, what, " is ", value, "; expected ", rule);
}

/// @throws std::invalid_argument as requireValue() unless the value is finite and > 0.
inline void requirePositive(const char* culprit, const char* what, double value) {
  requireValue(std::isfinite(value) && value > 0, culprit, what, value, "a finite value > 0");
}

/// @throws std::invalid_argument as requireValue() unless the value is finite and >= 0.
inline void requireNotNegative(const char* culprit, const char* what, double value) {
  requireValue(std::isfinite(value) && value >= 0, culprit, what, value, "a finite value >= 0");
}

/// Values of one culprit, each with what it is.
using NamedValues = std::initializer_list<std::pair<const char*, double>>;

/// requirePositive() for each, in this order.
inline void requirePositive(const char* culprit, NamedValues values) {
  for (const auto& [what, value] : values) requirePositive(culprit, what, value);
}

/// requireNotNegative() for each, in this order.
inline void requireNotNegative(const char* culprit, NamedValues values) {
  for (const auto& [what, value] : values) requireNotNegative(culprit, what, value);
}

// Results of checks of what data can cause, such as a message of another node.

/// Why something was refused, and the message for its sender.
///
/// @tparam Fault  enumeration of the reasons.
template <class Fault>
struct Refusal {
  Fault fault;
  std::string message;  ///< names the culprit and the remedy
};

/// The checked value, or why it was refused.
template <class T, class Fault>
using Checked = std::variant<T, Refusal<Fault>>;

}  // namespace helix_arm::basics
