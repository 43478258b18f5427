#pragma once

#include <chrono>
#include <vector>

#include "helix_arm/model/median.hpp"

namespace helix_arm::model {

/// Median time of one call [s], over several timings of as many calls as last long enough to be
/// timed.
/// @param timings  at least 1.
/// @param least    time that each lasts at least, > 0 [s].
template <class Call>
double medianTime(const Call& call, int timings = 9, double least = 2e-4) {
  using Clock = std::chrono::steady_clock;
  std::vector<double> times;
  for (int i = 0; i < timings; ++i) {
    int count = 0;
    double seconds = 0.0;
    for (const Clock::time_point start = Clock::now(); seconds < least;) {
      // The clock takes as long as a closed form: it is read once every few calls.
      for (int k = 0; k < 8; ++k) call();
      count += 8;
      seconds = std::chrono::duration<double>(Clock::now() - start).count();
    }
    times.push_back(seconds / count);
  }
  return medianOf(times);
}

}  // namespace helix_arm::model
