#pragma once

#include <algorithm>
#include <chrono>
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

/// Median time of one call [s] over several timings. Each timing repeats the call often enough to
/// last `least`. If a single call lasts ten times that, its time is returned.
/// @param timings  number of timings, at least 1.
/// @param least    minimum duration of each timing, > 0 [s].
template <class Call>
double medianTime(const Call& call, int timings = 9, double least = 2e-4) {
  using Clock = std::chrono::steady_clock;
  const auto timeOf = [&call](int count) {
    const Clock::time_point start = Clock::now();
    for (int i = 0; i < count; ++i) call();
    return std::chrono::duration<double>(Clock::now() - start).count();
  };
  const double first = timeOf(1);
  if (first >= 10.0 * least) return first;
  int count = 1;
  while (timeOf(count) < least) count *= 2;
  std::vector<double> times;
  for (int i = 0; i < timings; ++i) times.push_back(timeOf(count) / count);
  return medianOf(times);
}

}  // namespace helix_arm::basics
