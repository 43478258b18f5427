#pragma once

#include <array>

/// Polynomials for exp on SE(3) that need one fused product per term, and no other arithmetic.
namespace helix_arm::model::batch {

/// sum_k (-x)^k / (2k + n)! on [0, 2 centre] as a polynomial in x - centre, of which element j is
/// the coefficient of power j: its Chebyshev series, cut off after kDegree.
template <int kDegree>
constexpr std::array<double, kDegree + 1> economised(int n, long double centre) {
  constexpr int kTerms = 30;
  // (2 cos^2(phi/2))^k = 2^(1-k) (C(2k, k) / 2 + sum_m C(2k, k - m) cos(m phi)), and x is 2 centre
  // cos^2(phi/2) where x / centre - 1 = cos(phi).
  long double chebyshev[kDegree + 1] = {};
  long double term = 1.0L;  // (-centre / 2)^k / (2k + n)!
  for (int i = 2; i <= n; ++i) term /= i;
  for (int k = 0; k < kTerms; ++k) {
    long double binomial = 1.0L;  // C(2k, k - m)
    for (int m = k; m >= 0; --m) {
      if (m <= kDegree) chebyshev[m] += (m == 0 ? 1 : 2) * binomial * term;
      binomial = binomial * (k + m) / (k - m + 1);
    }
    term *= -centre / 2 / ((2 * k + n + 1) * (2 * k + n + 2));
  }
  // T_(m+1) = 2 t T_m - T_(m-1)
  long double before[kDegree + 1] = {}, present[kDegree + 1] = {}, sum[kDegree + 1] = {};
  present[0] = 1.0L;
  for (int m = 0; m <= kDegree; ++m) {
    long double next[kDegree + 1] = {};
    for (int j = 0; j <= kDegree; ++j) {
      sum[j] += chebyshev[m] * present[j];
      next[j] = (j > 0 ? (m > 0 ? 2 : 1) * present[j - 1] : 0.0L) - before[j];
    }
    for (int j = 0; j <= kDegree; ++j) {
      before[j] = present[j];
      present[j] = next[j];
    }
  }
  std::array<double, kDegree + 1> out{};
  long double scale = 1.0L;
  for (int j = 0; j <= kDegree; ++j) {
    out[j] = static_cast<double>(sum[j] * scale);
    scale /= centre;
  }
  return out;
}

}  // namespace helix_arm::model::batch
