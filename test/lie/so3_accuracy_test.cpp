// exp and log of rotations against their definitions in 80 digits.
#include <cstdio>

#include <gtest/gtest.h>

#include "helix_arm/basics/pi.hpp"
#include "helix_arm/lie/so3.hpp"
#include "lie/so3_switch.hpp"
#include "support/high_precision.hpp"
#include "support/random.hpp"

namespace helix_arm::lie {
namespace {

using test::kEps;
using test::Real;
using test::RealMatrix;

using basics::kPi;

// (x y z w) of exp(w): sin(|w| / 2) w / |w| and cos(|w| / 2).
RealMatrix expByDefinition(const Eigen::Vector3d& w) {
  const RealMatrix exact = w.cast<Real>();
  const Real angle = exact.norm(), half = angle / 2;
  RealMatrix q(4, 1);
  q.topRows(3) = exact * (angle > 0 ? Real(sin(half) / angle) : Real(0.5));
  q(3, 0) = cos(half);
  return q;
}

struct Worst {
  double entries = 0.0;  // of exp, in eps of 1
  double vector = 0.0;   // of exp's vector part, relative, in eps
  double log = 0.0;      // of the rounded exp, against w, relative, in eps

  void add(const Eigen::Vector3d& w) {
    const RealMatrix exact = expByDefinition(w);
    const SO3 R = SO3::exp(w);
    entries = std::max(entries, test::worstEps(R.quaternion.coeffs(), exact));
    if (w.norm() <= kPi) {
      vector = std::max(vector, test::relativeEps(R.quaternion.vec(), exact.topRows(3)));
      SO3 rounded;
      rounded.quaternion.coeffs() = exact.cast<double>();
      log = std::max(log, test::relativeEps(rounded.log(), w));
    }
  }
  void print(const char* where) const {
    std::printf("%s: entries %.2f, vector part %.2f, log %.2f eps\n", where, entries, vector, log);
  }
  void expectWithin(double bound) const {
    EXPECT_LE(entries, bound);
    EXPECT_LE(vector, bound);
    EXPECT_LE(log, bound);
  }
};

TEST(So3Accuracy, ExpAndLogWithin4EpsUpToAHalfTurn) {
  test::Random random(43);
  Worst worst;
  for (int i = 0; i < 3000; ++i) worst.add(random.logUniform(1e-300, 1.0) * random.direction<3>());
  for (int i = 0; i < 6000; ++i) worst.add(random.uniform(0, kPi) * random.direction<3>());
  for (int i = 0; i < 3000; ++i) {
    worst.add((kPi - random.logUniform(1e-12, 1e-1)) * random.direction<3>());
  }
  worst.print("to pi");
  worst.expectWithin(4.0);
}

TEST(So3Accuracy, ExpWithin8EpsUpToTwoTurns) {
  test::Random random(44);
  Worst worst;
  for (int i = 0; i < 6000; ++i) worst.add(random.uniform(kPi, 4 * kPi) * random.direction<3>());
  worst.print("to 4 pi");
  EXPECT_LE(worst.entries, 8.0);
}

// Angles around a switch-over, so many on each side of it.
void addAround(double angle, test::Random& random, Worst& below, Worst& above) {
  for (int ulps = 0; ulps < 500; ++ulps) {
    const Eigen::Vector3d axis = random.direction<3>();
    below.add(angle * (1 - (ulps + 4) * kEps) * axis);
    above.add(angle * (1 + (ulps + 4) * kEps) * axis);
    EXPECT_LT((angle * (1 - (ulps + 4) * kEps) * axis).norm(), angle);
    EXPECT_GT((angle * (1 + (ulps + 4) * kEps) * axis).norm(), angle);
  }
}

TEST(So3Accuracy, ExpIsAsGoodOnBothSidesOfItsSwitch) {
  test::Random random(45);
  Worst below, above;
  addAround(kSo3ExpSwitch, random, below, above);
  below.expectWithin(4.0);
  above.expectWithin(4.0);
}

TEST(So3Accuracy, LogIsAsGoodOnBothSidesOfItsSwitch) {
  test::Random random(46);
  Worst below, above;
  // The vector part of such a rotation is half its angle, to the last bit.
  addAround(2 * kSo3LogSwitch, random, below, above);
  below.expectWithin(4.0);
  above.expectWithin(4.0);
}

TEST(So3Accuracy, ExpAndLogOfTheTiniestAnglesAreTheirLimits) {
  for (const double angle : {5e-324, 1e-310, 1e-300, 1e-160}) {
    const SO3 R = SO3::exp({angle, 0, 0});
    EXPECT_EQ(R.quaternion.w(), 1.0);
    EXPECT_EQ(R.quaternion.x(), 0.5 * angle);
    SO3 half;
    half.quaternion.x() = angle;
    EXPECT_EQ(half.log().x(), 2.0 * angle);
  }
}

}  // namespace
}  // namespace helix_arm::lie
