#pragma once

#include <cmath>
#include <sstream>
#include <stdexcept>
#include <type_traits>

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

/// @throws std::invalid_argument with the concatenated message parts unless `holds`.
template <class... Parts>
void require(bool holds, const Parts&... message) {
  if (holds) return;
  std::ostringstream text;
  (writePart(text, message), ...);
  throw std::invalid_argument(text.str());
}

/// @throws std::invalid_argument "<culprit>: <what> is <value>; expected <rule>" unless `holds`.
template <class Value, class Rule>
void requireValue(bool holds, const char* culprit, const char* what, const Value& value,
                  const Rule& rule) {
  require(holds, culprit, ": ", what, " is ", value, "; expected ", rule);
}

}  // namespace helix_arm::basics
