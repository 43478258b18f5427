#include "helix_arm/model/contraction.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include <gtest/gtest.h>

#include "support/expect_refusal.hpp"
#include "support/has.hpp"
#include "support/paper_arm.hpp"
#include "support/random.hpp"
#include "support/refusal.hpp"

namespace helix_arm::model {
namespace {

constexpr double kEps = 2.220446049250313e-16;

TEST(Quintic, IsItsPolynomial) {
  const std::array<double, 6> c = {0.43, -0.02, -0.3, 0.1, 0.2, -0.12};
  const Contraction curve = Contraction::quintic(c, 4e5, 3e5);
  for (const double p : {0.0, 1.0, 1e5, 2.7e5, 3e5}) {
    long double expected = 0, power = 1;
    for (const double coefficient : c) {
      expected += coefficient * power;
      power *= static_cast<long double>(p) / 4e5L;
    }
    EXPECT_NEAR(curve.length(p), static_cast<double>(expected), 2 * kEps) << p;
  }
  EXPECT_EQ(curve.inputRange().upper, 3e5);
}

TEST(Quintic, ThatIsNotMonotoneIsRefusedWithThePressure) {
  // The planar arms' muscle, printed for psi: it rises again above 562 kPa.
  const std::array<double, 6> c = {4.422327618e-1, -8.616576226e-4, -1.351653817e-4,
                                   4.567416495e-6, -5.593052718e-8, 2.401903883e-10};
  EXPECT_NO_THROW(Contraction::quintic(c, test::kPsi, 560e3));
  const std::string message = test::refusal([&] { Contraction::quintic(c, test::kPsi, 600e3); });
  EXPECT_TRUE(test::has(message, "reverses is 56"));
}

TEST(Table, GoesThroughItsPointsAndNeverTurnsBetweenThem) {
  test::Random random(41);
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<double> p = {0}, l = {0.43};
    const bool rising = trial % 2 == 1;
    for (int i = 0; i < 12; ++i) {
      p.push_back(p.back() + random.logUniform(1e2, 1e5));
      l.push_back(l.back() + (rising ? 1 : -1) * random.logUniform(1e-6, 0.03));
    }
    const Contraction curve = Contraction::table(p, l);
    for (std::size_t i = 0; i < p.size(); ++i) EXPECT_NEAR(curve.length(p[i]), l[i], 4 * kEps);
    double previous = curve.length(0);
    for (int k = 1; k <= 2000; ++k) {
      const double length = curve.length(std::min(p.back() * k / 2000, p.back()));
      EXPECT_LE((rising ? -1 : 1) * (length - previous), 2 * kEps);
      previous = length;
    }
  }
}

TEST(Table, RefusesATableThatIsNotMonotone) {
  test::expectRefusal("pressure of point 3", [] {
    Contraction::table({0, 1e5, 1e5}, {0.4, 0.3, 0.2});
  });
  test::expectRefusal("length of point 3", [] {
    Contraction::table({0, 1e5, 2e5}, {0.4, 0.3, 0.31});
  });
  test::expectRefusal("length of point 2", [] { Contraction::table({0, 1e5}, {0.4, 0.4}); });
}

class EveryContraction : public ::testing::TestWithParam<Contraction> {};

TEST_P(EveryContraction, InverseUndoesLength) {
  const Contraction& curve = GetParam();
  const Range range = curve.inputRange();
  test::Random random(42);
  for (int i = 0; i < 20000; ++i) {
    const double q = i == 0   ? range.lower
                     : i == 1 ? range.upper
                              : random.uniform(range.lower, range.upper);
    const double length = curve.length(q);
    EXPECT_NEAR(curve.length(curve.inverse(length)), length, 4 * kEps) << q;
    const double guess = random.uniform(range.lower, range.upper);
    EXPECT_NEAR(curve.length(curve.inverseInside(length, guess)), length, 4 * kEps)
        << q << " from " << guess;
  }
}

TEST_P(EveryContraction, SlopeIsTheDerivative) {
  const Contraction& curve = GetParam();
  const Range range = curve.inputRange();
  const double step = 1e-6 * (range.upper - range.lower);
  test::Random random(43);
  for (int i = 0; i < 1000; ++i) {
    const double q = random.uniform(range.lower + step, range.upper - step);
    const double difference = (curve.length(q + step) - curve.length(q - step)) / (2 * step);
    const double mean =
        (curve.lengthRange().upper - curve.lengthRange().lower) / (range.upper - range.lower);
    EXPECT_NEAR(curve.slope(q), difference, 1e-4 * mean);
  }
}

TEST_P(EveryContraction, IsNeverExtrapolated) {
  const Contraction& curve = GetParam();
  const Range in = curve.inputRange(), out = curve.lengthRange();
  for (const double q : {std::nextafter(in.lower, -1e9), std::nextafter(in.upper, 1e9), double(NAN),
                         double(INFINITY)}) {
    EXPECT_THROW(curve.length(q), std::out_of_range) << q;
    EXPECT_THROW(curve.slope(q), std::out_of_range) << q;
  }
  for (const double l : {std::nextafter(out.lower, 0), std::nextafter(out.upper, 1), double(NAN)}) {
    EXPECT_THROW(curve.inverse(l), std::out_of_range) << l;
  }
}

TEST_P(EveryContraction, ScalesItsLengthsAndNotItsInputs) {
  const Contraction& curve = GetParam();
  const Range range = curve.inputRange();
  test::Random random(45);
  for (const double factor : {0.97, 1.0, 1.6}) {
    const Contraction scaled = curve.scaledBy(factor), longer = curve.scaledBy(factor, 1.1);
    EXPECT_EQ(scaled.inputRange().lower, range.lower);
    EXPECT_EQ(scaled.inputRange().upper, range.upper);
    EXPECT_NEAR(scaled.lengthRange().lower, factor * curve.lengthRange().lower, 4 * kEps);
    EXPECT_NEAR(scaled.lengthRange().upper, factor * curve.lengthRange().upper, 4 * kEps);
    for (int i = 0; i < 1000; ++i) {
      const double q = random.uniform(range.lower, range.upper);
      EXPECT_NEAR(scaled.length(q), factor * curve.length(q), 4 * kEps) << q;
      EXPECT_NEAR(scaled.length(scaled.inverse(scaled.length(q))), scaled.length(q), 4 * kEps) << q;
      const double rest = curve.length(range.lower);
      EXPECT_NEAR(longer.length(q), factor * (rest + 1.1 * (curve.length(q) - rest)), 8 * kEps);
      EXPECT_NEAR(longer.slope(q), factor * 1.1 * curve.slope(q), 1e-12 * std::abs(curve.slope(q)));
      EXPECT_NEAR(longer.length(longer.inverse(longer.length(q))), longer.length(q), 8 * kEps);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(, EveryContraction,
                         ::testing::Values(test::fig3Muscle(), Contraction::tendon(0.4, 0.01, 20),
                                           Contraction::table({0, 5e4, 1e5, 3e5, 4e5},
                                                              {0.43, 0.429, 0.40, 0.35, 0.349}),
                                           Contraction::table({0, 1e5}, {0.1, 0.2})));

}  // namespace
}  // namespace helix_arm::model
