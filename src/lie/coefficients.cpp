#include "lie/coefficients.hpp"

namespace helix_arm::lie {
namespace {

// h cot h has the series sum_k -|B_2k| (2h)^2k / (2k)!, 2h = theta; |B_2k| / (2k)! for k = 1
// .. 14. Its radius is 2 pi: 14 terms leave 1e-18 at the switch.
constexpr double kCoefficients[] = {
    8.3333333333333333e-02, 1.3888888888888889e-03, 3.3068783068783069e-05, 8.2671957671957672e-07,
    2.0876756987868099e-08, 5.2841901386874932e-10, 1.3382536530684679e-11, 3.3896802963225829e-13,
    8.5860620562778446e-15, 2.1748686985580619e-16, 5.5090028283602295e-18, 1.3954464685812523e-19,
    3.5347070396294675e-21, 8.9535174270375469e-23};

}  // namespace

double logCoefficient(double x) {
  if (x >= kLogSeriesLimit) {
    const ExpCoefficients f = expCoefficients(x);
    return (1.0 - f.a / (2.0 * f.b)) / x;
  }
  double sum = 0.0;
  for (int k = 13; k >= 0; --k) sum = sum * x + kCoefficients[k];
  return sum;
}

LogCoefficient logCoefficientAndSlope(double x) {
  if (x >= kLogSeriesLimit) {
    // 2 da/dx = c - b and 2 db/dx = 2d - c
    const auto [a, b, c, d, e] = jacobianCoefficients(x);
    const double ratio = a / (2.0 * b);
    const double ratio_slope = (0.5 * (c - b) - ratio * (2.0 * d - c)) / (2.0 * b);
    const double value = (1.0 - ratio) / x;
    return {value, -(ratio_slope + value) / x};
  }
  double sum = 0.0, slope = 0.0;
  for (int k = 13; k >= 0; --k) {
    slope = slope * x + sum;
    sum = sum * x + kCoefficients[k];
  }
  return {sum, slope};
}

double logCoefficientCurvature(double x) {
  if (x >= kLogSeriesLimit) {
    // From its differential equation, x g' = x g^2 / 2 - 3 g / 2 + 1 / 8.
    const auto [g, slope] = logCoefficientAndSlope(x);
    return (0.5 * g * g - 2.5 * slope) / x + g * slope;
  }
  double sum = 0.0;
  for (int k = 13; k >= 2; --k) sum = sum * x + k * (k - 1) * kCoefficients[k];
  return sum;
}

}  // namespace helix_arm::lie
