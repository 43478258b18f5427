#pragma once

#include <stdexcept>
#include <string>

namespace helix_arm::model {

/// @throws std::invalid_argument unless count >= 2.
inline void requireCurve(int count) {
  if (count >= 2) return;
  throw std::invalid_argument("a curve of " + std::to_string(count) +
                              " points; expected at least 2");
}

/// s of point i of `count` evenly spaced points along `sections` sections, in [0, sections].
inline double curvePlace(int sections, int i, int count) {
  return static_cast<double>(sections) * i / (count - 1);
}

}  // namespace helix_arm::model
