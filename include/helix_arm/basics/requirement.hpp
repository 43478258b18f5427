#pragma once

#include <sstream>
#include <stdexcept>

namespace helix_arm::basics {

/// @throws std::invalid_argument with the concatenated message parts unless `holds`.
template <class... Parts>
void require(bool holds, const Parts&... message) {
  if (holds) return;
  std::ostringstream text;
  (text << ... << message);
  throw std::invalid_argument(text.str());
}

/// @throws std::invalid_argument "<culprit>: <what> is <value>; expected <rule>" unless `holds`.
template <class Value, class Rule>
void requireValue(bool holds, const char* culprit, const char* what, const Value& value,
                  const Rule& rule) {
  require(holds, culprit, ": ", what, " is ", value, "; expected ", rule);
}

}  // namespace helix_arm::basics
