#pragma once

#include <cmath>
#include <cstdlib>
#include <stdexcept>
#include <string>

/// Number of draws of a test, and bounds that follow from it.
///
///     const int rigs = test::draws(12, 100);  // 12 by default, 100 with scripts/test --all
///     EXPECT_LE(misses, test::mostOf(rigs, 0.003));
namespace helix_arm::test {

/// Whether the environment variable HELIX_ARM_TEST_SIZE is `all`; it may also be `default` or
/// unset.
inline bool isFullSize() {
  const char* const value = std::getenv("HELIX_ARM_TEST_SIZE");
  const std::string size = value == nullptr ? "default" : value;
  if (size != "all" && size != "default") {
    throw std::runtime_error("HELIX_ARM_TEST_SIZE is " + size + "; expected all or default");
  }
  return size == "all";
}

/// Message of a case that is skipped by default.
inline constexpr char kFullSizeOnly[] =
    "runs with HELIX_ARM_TEST_SIZE=all, as scripts/test --all sets it";

inline int draws(int by_default, int full) { return isFullSize() ? full : by_default; }

/// Whether a case is run: each in full size, by default the first of every `stride`.
inline bool isDrawn(int number, int stride) { return isFullSize() || number % stride == 0; }

// Probability with which a bound of this file refuses a sound program. Draws are seeded: it does so
// when it is changed, not now and then.
inline constexpr double kFalseAlarm = 0.01;

/// Largest count to be expected among n independent draws that are true with probability p each:
/// the least k for which P(X > k) <= kFalseAlarm, X binomial. @pre 0 < p < 1.
inline int mostOf(int n, double p) {
  double log_term = n * std::log1p(-p);  // of P(X = k)
  double below = std::exp(log_term);     // P(X <= k)
  int k = 0;
  while (k < n && 1.0 - below > kFalseAlarm) {
    log_term += std::log(static_cast<double>(n - k) / (k + 1)) + std::log(p) - std::log1p(-p);
    below += std::exp(log_term);
    ++k;
  }
  return k;
}

/// Smallest count to be expected, likewise.
inline int leastOf(int n, double p) { return n - mostOf(n, 1.0 - p); }

}  // namespace helix_arm::test
