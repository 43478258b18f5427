#pragma once

#include <cmath>

/// The scalar functions of the rotation angle that exp, log and their Jacobians are made of.
///
/// All of them are even and analytic, so they are written in x = theta^2 and are finite at zero. They are free of
/// branches (a `?:` selects between two finished values), so a loop over them vectorises.
namespace helix_arm::lie {

/// Coefficients of exp; theta = |w| [rad].
struct ExpCoefficients {
  double a;  ///< sin(theta) / theta
  double b;  ///< (1 - cos(theta)) / theta^2
  double c;  ///< (theta - sin(theta)) / theta^3
};

/// Coefficients of the Jacobians of exp: those of exp and the next two of the same family.
struct JacobianCoefficients {
  double a, b, c;
  double d;  ///< (1/2 - b) / theta^2 = (theta^2/2 + cos(theta) - 1) / theta^4
  double e;  ///< (1/6 - c) / theta^2 = (theta^3/6 - theta + sin(theta)) / theta^5
};

/// Below this theta^2 the coefficients c, d, e come from their Taylor series, above it from a, b, c.
inline constexpr double kSeriesLimitC = 2.0;
inline constexpr double kSeriesLimitDe = 6.0;
/// Below this theta^2 the coefficient of log comes from its Taylor series.
inline constexpr double kSeriesLimitLog = 2.0;
/// Above this theta^2 the argument reduction of expCoefficients loses its last bits [rad^2].
inline constexpr double kReductionLimit = 1e10;

namespace detail {

/// n! for small n; exact in double up to 22!.
constexpr double factorial(int n) { return n < 2 ? 1.0 : n * factorial(n - 1); }

/// sum_k (-x)^k / (2k + n)!, k < terms: the Taylor series of a (n = 1), b (2), c (3), d (4), e (5), and cos (0).
template <int kFirst, int kTerms, int kTerm = 0>
inline double factorialSeries(double x) {
  constexpr double kCoefficient = (kTerm % 2 == 0 ? 1.0 : -1.0) / factorial(2 * kTerm + kFirst);
  if constexpr (kTerm + 1 == kTerms) {
    return kCoefficient;
  } else {
    return factorialSeries<kFirst, kTerms, kTerm + 1>(x) * x + kCoefficient;
  }
}

}  // namespace detail

/// Coefficients of exp at x = theta^2 [rad^2], relative to 1 (a, b) and to themselves (c) within 4 eps.
///
/// @param x  in [0, kReductionLimit]; NaN gives NaN.
inline ExpCoefficients expCoefficients(double x) {
  // Half the angle, reduced to |r| <= pi/4 in three parts of pi/2 (Cody and Waite), so that k * part is exact.
  constexpr double kRound = 6755399441055744.0;  // 1.5 * 2^52: adding and subtracting it rounds to an integer
  constexpr double kTwoOverPi = 0.63661977236758138;
  constexpr double kHalfPi1 = 1.57079632673412561417;      // its first 33 bits
  constexpr double kHalfPi2 = 6.07710050630396597660e-11;  // the next 33
  constexpr double kHalfPi3 = 2.02226624879595063154e-21;
  const double h = 0.5 * std::sqrt(x);
  const double k = (h * kTwoOverPi + kRound) - kRound;
  const double r = ((h - k * kHalfPi1) - k * kHalfPi2) - k * kHalfPi3;
  const double odd = k - 2.0 * ((0.5 * k - 0.25 + kRound) - kRound);  // 0 or 1

  const double y = r * r;
  const double sinc_r = detail::factorialSeries<1, 8>(y);
  const double cos_r = detail::factorialSeries<0, 9>(y);
  const double sin_r = r * sinc_r;

  // h = r + k pi/2. The signs that an even or odd k brings cancel in a and b, up to (-1)^k in a.
  const double sin_h = odd != 0.0 ? cos_r : sin_r;
  const double cos_h = odd != 0.0 ? -sin_r : cos_r;
  const double sinc_h = k == 0.0 ? sinc_r : sin_h / h;

  ExpCoefficients out{};
  out.a = sinc_h * cos_h;
  out.b = 0.5 * sinc_h * sinc_h;
  const double c_series = detail::factorialSeries<3, 10>(x);
  const double c_closed = (1.0 - out.a) / x;
  out.c = x < kSeriesLimitC ? c_series : c_closed;
  return out;
}

/// Coefficients of the Jacobians at x = theta^2 [rad^2]; same domain as expCoefficients.
inline JacobianCoefficients jacobianCoefficients(double x) {
  const ExpCoefficients f = expCoefficients(x);
  const bool series = x < kSeriesLimitDe;
  return {f.a, f.b, f.c,  //
          series ? detail::factorialSeries<4, 13>(x) : (0.5 - f.b) / x,
          series ? detail::factorialSeries<5, 12>(x) : (1.0 / 6.0 - f.c) / x};
}

}  // namespace helix_arm::lie
