#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

/// Scalar functions of the rotation angle theta that appear in exp, log and their Jacobians.
///
/// All of them are even and analytic, so they are written in x = theta^2 and are finite at zero. Up
/// to theta = 4.5 rad, the usual range of arms, they are series of the half angle without roots,
/// quotients or branches; beyond, they use sine and cosine of the reduced half angle. Neither
/// depends on the C library, so every machine gives the same digits up to fused products.
namespace helix_arm::lie {

/// Coefficients of exp; theta = |w| [rad].
struct ExpCoefficients {
  double a;       ///< sin(theta) / theta
  double b;       ///< (1 - cos(theta)) / theta^2
  double c;       ///< (theta - sin(theta)) / theta^3
  double cosine;  ///< cos(theta)
};

/// Coefficients of the Jacobians of exp: those of exp and two more of the same family.
struct JacobianCoefficients {
  double a, b, c;
  double d;  ///< (1/2 - b) / theta^2 = (theta^2/2 + cos(theta) - 1) / theta^4
  double e;  ///< (1/6 - c) / theta^2 = (theta^3/6 - theta + sin(theta)) / theta^5
};

/// Upper limit of theta^2 for the series [rad^2].
inline constexpr double kSeriesLimit = 20.0;
/// theta^2 above which the argument reduction loses its last bits [rad^2].
inline constexpr double kReductionLimit = 1e10;

namespace detail {

/// n! for n <= 33, exact up to 22! and within an ulp beyond.
constexpr double factorial(int n) { return n < 2 ? 1.0 : n * factorial(n - 1); }

/// sum_j (-y)^j / (2j + n)! over kBegin <= j < kBegin + kCount, divided by y^kBegin. Pairs first
/// (Estrin): half the latency of Horner's rule. powers: y, y^2, y^4, y^8.
template <int kFirst, int kBegin, int kCount>
inline double factorialSeries(const double* powers) {
  if constexpr (kCount == 1) {
    return (kBegin % 2 == 0 ? 1.0 : -1.0) / factorial(2 * kBegin + kFirst);
  } else {
    constexpr int kLevel = kCount > 8 ? 3 : kCount > 4 ? 2 : kCount > 2 ? 1 : 0;
    constexpr int kHalf = 1 << kLevel;
    return factorialSeries<kFirst, kBegin, kHalf>(powers) +
           factorialSeries<kFirst, kBegin + kHalf, kCount - kHalf>(powers) * powers[kLevel];
  }
}

/// sum_j (-y)^j / (2j + n)!, with y = r^2: (1 - cos r) / r^2 at n = 2, (r - sin r) / r^3 at n = 3.
template <int kFirst, int kTerms>
inline double factorialSeries(double y) {
  const double y2 = y * y, y4 = y2 * y2;
  const double powers[] = {y, y2, y4, y4 * y4};
  return factorialSeries<kFirst, 0, kTerms>(powers);
}

/// square - root * root, accurate to the last bit (Dekker), for |root| < 1e150.
inline double squareRemainder(double square, double root) {
  // The root is halved by its bits, not by arithmetic, which would fail where products are fused.
  constexpr std::uint64_t kUpperDigits = ~((std::uint64_t{1} << 27) - 1);
  std::uint64_t bits = 0;
  std::memcpy(&bits, &root, sizeof bits);
  bits &= kUpperDigits;
  double high = 0;
  std::memcpy(&high, &bits, sizeof high);
  const double low = root - high;
  return ((square - high * high) - 2.0 * high * low) - low * low;
}

/// Sine and cosine of the half angle h and s_n = sum_j (-y)^j / (2j + n)! with y = h^2, for
/// x <= kSeriesLimit; s_2 and s_3 from s_4 and s_5, whose rounding errors have less weight.
struct HalfAngleSeries {
  double y;             ///< h^2
  double s4, s5;        ///< (1/2 - s2) / h^2, (1/6 - s3) / h^2
  double s2, s3;        ///< (1 - cos h) / h^2, (h - sin h) / h^3
  double sinc, cosine;  ///< of h

  explicit HalfAngleSeries(double x)
      : y(0.25 * x),
        s4(factorialSeries<4, 11>(y)),
        s5(factorialSeries<5, 10>(y)),
        s2(0.5 - y * s4),
        s3(1.0 / 6.0 - y * s5),
        sinc((1.0 - (1.0 / 6.0) * y) + (y * y) * s5),
        cosine((1.0 - 0.5 * y) + (y * y) * s4) {}
  double a() const { return sinc * cosine; }
  double b() const { return 0.5 * s2 * (1.0 + cosine); }
  double c() const { return 0.25 * (s2 + s3 - y * s2 * s3); }
  double d() const { return 0.125 * s3 * (1.0 + sinc); }
  double e() const { return 0.0625 * (s4 + s5 + s2 * s3); }
};

/// theta^2 up to which the cosine is computed as 1 - b theta^2, and beyond which as 2
/// cos^2(theta/2) - 1. Each form magnifies rounding errors where the other does not.
inline constexpr double kVersineLimit = 2.5;

inline ExpCoefficients expCoefficientsBySeries(double x) {
  const HalfAngleSeries f(x);
  const double b = f.b();
  return {f.a(), b, f.c(), x < kVersineLimit ? 1.0 - b * x : 2.0 * f.cosine * f.cosine - 1.0};
}

/// For x from about 1 up to kReductionLimit; finite but meaningless below.
/// @param x_low  rounding error of x, which matters at large angles.
inline ExpCoefficients expCoefficientsByReduction(double x, double x_low) {
  // h = r + k pi/2, |r| <= pi/4, with pi/2 in three parts (Cody and Waite): k times the first two
  // is exact.
  // 1.5 * 2^52: adding and subtracting it rounds to an integer.
  constexpr double kRound = 6755399441055744.0;
  constexpr double kTwoOverPi = 0.63661977236758138;
  constexpr double kHalfPi1 = 1.57079632673412561417;
  constexpr double kHalfPi2 = 6.07710050630396597660e-11;
  constexpr double kHalfPi3 = 2.02226624879595063154e-21;
  constexpr double kTiny = 1e-100;  // keeps the quotients finite at zero
  const double h = 0.5 * std::sqrt(x);
  const double k = (h * kTwoOverPi + kRound) - kRound;
  const double h_low = (squareRemainder(0.25 * x, h) + 0.25 * x_low) / (2.0 * h + kTiny);
  const double r = ((h - k * kHalfPi1) - k * kHalfPi2) + (h_low - k * kHalfPi3);
  const double y = r * r;
  const double sin_r = r - r * (y * factorialSeries<3, 8>(y));
  const double cos_r = 1.0 - y * factorialSeries<2, 8>(y);
  // A quarter turn exchanges sine and cosine; their signs cancel wherever they are used.
  const double odd = k - 2.0 * ((0.5 * k - 0.25 + kRound) - kRound);  // 0 or 1
  const double even = 1.0 - odd;
  const double sin_h = even * sin_r + odd * cos_r;
  const double cos_h = even * cos_r - odd * sin_r;
  const double a = sin_h * cos_h / (h + kTiny);
  const double inverse_x = 1.0 / (x + kTiny);
  return {a, 2.0 * sin_h * sin_h * inverse_x, (1.0 - a) * inverse_x,
          (cos_h - sin_h) * (cos_h + sin_h)};
}

}  // namespace detail

/// Coefficients of exp at x + x_low = theta^2 [rad^2], x in [0, kReductionLimit]; NaN gives NaN.
inline ExpCoefficients expCoefficients(double x, double x_low = 0.0) {
  return x <= kSeriesLimit ? detail::expCoefficientsBySeries(x)
                           : detail::expCoefficientsByReduction(x, x_low);
}

/// Coefficients of the Jacobians at x = theta^2 [rad^2]; same domain.
inline JacobianCoefficients jacobianCoefficients(double x) {
  if (x <= kSeriesLimit) {
    const detail::HalfAngleSeries f(x);
    return {f.a(), f.b(), f.c(), f.d(), f.e()};
  }
  const ExpCoefficients f = detail::expCoefficientsByReduction(x, 0.0);
  return {f.a, f.b, f.c, (0.5 - f.b) / x, (1.0 / 6.0 - f.c) / x};
}

/// theta^2 [rad^2] from which a quotient is used; below, a series, since the quotient cancels.
inline constexpr double kLogSeriesLimit = 2.0;

/// (1 - (theta/2) cot(theta/2)) / theta^2 at x = theta^2 [rad^2], the coefficient of [w]^2 in V^-1.
/// Infinite where theta = 2 pi k, k > 0.
double logCoefficient(double x);

/// logCoefficient() and its derivative with respect to x.
struct LogCoefficient {
  double value;
  double slope;  ///< [1/rad^2]
};
LogCoefficient logCoefficientAndSlope(double x);

/// Its second derivative with respect to x [1/rad^4].
double logCoefficientCurvature(double x);

}  // namespace helix_arm::lie
