// The coefficients themselves, where finite differences of exp would see nothing.
#include "lie/coefficients.hpp"

#include <cmath>
#include <cstdio>

#include <gtest/gtest.h>

#include "basics/vector_clones.hpp"
#include "helix_arm/basics/pi.hpp"
#include "support/high_precision.hpp"
#include "support/random.hpp"

namespace helix_arm::lie {
namespace {

using test::Real;

using basics::kPi;

// Definitions, by their series where the quotients cancel.
struct Reference {
  Real a, b, c, d, e;
  explicit Reference(const Real& x) {
    const auto series = [&x](int first) {
      Real term = 1, sum = 0;
      for (int k = 2; k <= first; ++k) term /= k;
      for (int j = 0; j < 60; ++j) {
        sum += term;
        term *= -x / ((2 * j + first + 1) * (2 * j + first + 2));
      }
      return sum;
    };
    if (x < 1) {
      a = series(1), b = series(2), c = series(3), d = series(4), e = series(5);
    } else {
      const Real theta = sqrt(x);
      a = sin(theta) / theta;
      b = (1 - cos(theta)) / x;
      c = (1 - a) / x;
      d = (Real(0.5) - b) / x;
      e = (Real(1) / 6 - c) / x;
    }
  }
};

struct Worst {
  double a = 0, b = 0, c = 0, d = 0, e = 0, cosine = 0;

  void measure(double x) {
    const Reference exact{Real(x)};
    const ExpCoefficients f = expCoefficients(x);
    const JacobianCoefficients g = jacobianCoefficients(x);
    const double theta = std::sqrt(x);
    const auto eps = [](const Real& error) {
      return static_cast<double>(Real(abs(error) / test::kEps));
    };
    // a and b vanish at some angles: a is held to sin(theta), b to what a half turn's neighbourhood
    // allows.
    a = std::max(a, eps((exact.a - f.a) * std::max(1.0, theta)));
    if (theta < 3 || std::abs(std::remainder(theta, 2 * kPi)) > 0.5)
      b = std::max(b, eps((exact.b - f.b) / exact.b));
    c = std::max(c, eps((exact.c - f.c) / exact.c));
    d = std::max(d, eps((exact.d - g.d) / exact.d));
    e = std::max(e, eps((exact.e - g.e) / exact.e));
    cosine = std::max(cosine, eps(1 - exact.b * x - f.cosine));
    EXPECT_EQ(f.a, g.a);
    EXPECT_EQ(f.b, g.b);
    EXPECT_EQ(f.c, g.c);
  }
  void print(const char* where) const {
    std::printf("%s: a %.2f b %.2f c %.2f d %.2f e %.2f cos %.2f eps\n", where, a, b, c, d, e,
                cosine);
  }
  void expectWithin(double bound) const {
    EXPECT_LE(a, bound);
    EXPECT_LE(b, bound);
    EXPECT_LE(c, bound);
    EXPECT_LE(d, bound);
    EXPECT_LE(e, bound);
    EXPECT_LE(cosine, bound);
  }
};

TEST(Coefficients, HoldTheirDigitsFrom1e300ToAHalfTurn) {
  test::Random random(31);
  Worst worst;
  for (int i = 0; i < 5000; ++i) worst.measure(std::pow(random.logUniform(1e-300, kPi), 2));
  for (int i = 0; i < 5000; ++i) worst.measure(random.uniform(0, kPi * kPi));
  worst.print("to pi");
  worst.expectWithin(4.0);
}

TEST(Coefficients, HoldTheirDigitsUpTo1e3) {
  test::Random random(32);
  Worst worst;
  for (int i = 0; i < 10000; ++i) worst.measure(std::pow(random.uniform(kPi, 1e3), 2));
  worst.print("to 1e3");
  worst.expectWithin(8.0);
}

TEST(Coefficients, AgreeWithTheirDefinitionOnBothSidesOfTheSwitch) {
  Worst below, above;
  for (int ulps = 0; ulps < 500; ++ulps) {
    below.measure(kSeriesLimit * (1 - ulps * test::kEps));
    above.measure(kSeriesLimit * (1 + (ulps + 1) * test::kEps));
  }
  below.print("below the switch");
  above.print("above the switch");
  below.expectWithin(6.0);
  above.expectWithin(6.0);
}

TEST(Coefficients, CosineIsAsGoodWhereItsTwoFormsMeet) {
  Worst below, above;
  for (int ulps = 0; ulps < 500; ++ulps) {
    below.measure(detail::kVersineLimit * (1 - ulps * test::kEps));
    above.measure(detail::kVersineLimit * (1 + (ulps + 1) * test::kEps));
  }
  below.print("below the versine's limit");
  above.print("above the versine's limit");
  below.expectWithin(4.0);
  above.expectWithin(4.0);
}

// (1 - (theta/2) cot(theta/2)) / theta^2, by the series of a / (2 b) where it would cancel.
double logErrorEps(double x) {
  const Reference f{Real(x)};
  const Real exact = x < 1e-20 ? Real(1) / 12 : (1 - f.a / (2 * f.b)) / Real(x);
  return static_cast<double>(Real(abs((exact - logCoefficient(x)) / exact) / test::kEps));
}

TEST(LogCoefficient, KeepsItsDigitsUpToAHalfTurnAndOnBothSidesOfItsSwitch) {
  test::Random random(33);
  double worst = 0;
  for (int i = 0; i < 3000; ++i) {
    worst = std::max(worst, logErrorEps(std::pow(random.logUniform(1e-300, kPi), 2)));
    worst = std::max(worst, logErrorEps(random.uniform(0, kPi * kPi)));
  }
  double at_switch = 0;
  for (int ulps = -500; ulps <= 500; ++ulps) {
    at_switch = std::max(at_switch, logErrorEps(kLogSeriesLimit * (1 + ulps * test::kEps)));
  }
  std::printf("log coefficient: %.2f eps, %.2f at its switch\n", worst, at_switch);
  // Its term in log is theta^2 / 12 of the whole, so these are less than one eps of a result.
  EXPECT_LE(worst, 16.0);
  EXPECT_LE(at_switch, 16.0);
}

TEST(Coefficients, AgreeWithTheirDefinitionWhereTheReductionChangesQuadrant) {
  Worst worst;
  for (int quadrant = 3; quadrant < 600; quadrant += 2) {
    const double theta = quadrant * kPi / 2;  // h half-way between two multiples of pi/2
    for (int ulps = -5; ulps <= 5; ++ulps)
      worst.measure(std::pow(theta * (1 + ulps * test::kEps), 2));
  }
  worst.print("at the quadrants");
  worst.expectWithin(8.0);
}

// With fused products where the processor has them.
HELIX_ARM_CLONES double remainderOf(double square, double root) {
  return detail::squareRemainder(square, root);
}

TEST(SquareRemainder, KeepsItsDigitsWithFusedProductsToo) {
  test::Random random(7);
  for (int i = 0; i < 20000; ++i) {
    const double root = random.logUniform(1e-100, 1e100);
    const double square = root * root;
    EXPECT_NEAR(remainderOf(square, root), -std::fma(root, root, -square), 1e-31 * square);
  }
}

TEST(Coefficients, AreTheirLimitsAtZeroAndForDenormals) {
  for (const double x : {0.0, 5e-324, 1e-310, 1e-300}) {
    const JacobianCoefficients f = jacobianCoefficients(x);
    EXPECT_EQ(f.a, 1.0);
    EXPECT_EQ(f.b, 0.5);
    EXPECT_EQ(f.c, 1.0 / 6.0);
    EXPECT_EQ(f.d, 1.0 / 24.0);
    EXPECT_EQ(f.e, 1.0 / 120.0);
  }
}

TEST(Coefficients, PassNotANumberOn) { EXPECT_TRUE(std::isnan(expCoefficients(std::nan("")).a)); }

}  // namespace
}  // namespace helix_arm::lie
