#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace helix_arm::basics {

/// Median of the values; for an even number, the mean of the two middle values.
/// @param values  at least one; none NaN.
inline double medianOf(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  return values.size() % 2 == 1 ? values[half] : 0.5 * (values[half - 1] + values[half]);
}

}  // namespace helix_arm::basics
