#pragma once

#include <sstream>
#include <stdexcept>

namespace helix_arm::simulation {

/// @throws std::invalid_argument "<culprit>: <what> is <value>; expected <rule>" unless it holds.
template <class Value>
void require(bool holds, const char* culprit, const char* what, const Value& value,
             const char* rule) {
  if (holds) return;
  std::ostringstream message;
  message << culprit << ": " << what << " is " << value << "; expected " << rule;
  throw std::invalid_argument(message.str());
}

}  // namespace helix_arm::simulation
