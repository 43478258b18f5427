#pragma once

#include <cmath>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::basics {

/// @throws std::invalid_argument as requireValue() unless the value is finite and > 0.
inline void requirePositive(const char* culprit, const char* what, double value) {
  requireValue(std::isfinite(value) && value > 0, culprit, what, value, "a finite value > 0");
}

/// @throws std::invalid_argument as requireValue() unless the value is finite and >= 0.
inline void requireNotNegative(const char* culprit, const char* what, double value) {
  requireValue(std::isfinite(value) && value >= 0, culprit, what, value, "a finite value >= 0");
}

}  // namespace helix_arm::basics
