// exp, log and the Jacobians against their definitions in 80 digits.
#include <cmath>
#include <cstdio>
#include <functional>
#include <utility>

#include <gtest/gtest.h>

#include "basics/pi.hpp"
#include "helix_arm/lie/se2.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/lie/so3.hpp"
#include "lie/coefficients.hpp"
#include "lie/so3_switch.hpp"
#include "support/high_precision.hpp"
#include "support/random.hpp"
#include "support/test_size.hpp"

namespace helix_arm::lie {
namespace {

using namespace test;

using basics::kPi;

// Arithmetic in 80 digits takes its time.
int some(int full) { return test::draws(full / 10, full); }

struct Worst {
  double rotation = 0.0;     // largest entry, in eps of 1
  double translation = 0.0;  // relative, in eps
  void add(const Worst& other) {
    rotation = std::max(rotation, other.rotation);
    translation = std::max(translation, other.translation);
  }
  void expectWithin(double limit, const char* what) const {
    std::printf("%s: rotation %.2f eps, translation %.2f eps\n", what, rotation, translation);
    EXPECT_LE(rotation, limit);
    EXPECT_LE(translation, limit);
  }
};

template <class Group>
class Accuracy : public ::testing::Test {
 protected:
  using Tangent = typename Group::Tangent;
  static constexpr int kSpace = Group::kSpace;

  Tangent twist(double angle) {
    Tangent xi;
    xi.template head<kSpace>() = random_.logUniform(1e-3, 1e1) * random_.direction<kSpace>();
    xi.template tail<Group::kRotations>() = angle * random_.direction<Group::kRotations>();
    return xi;
  }
  static Worst errorOfExp(const Tangent& xi) {
    const Group X = Group::exp(xi);
    const RealMatrix reference = test::expOfMatrix(test::hat(xi));
    return {test::worstEps(X.rotation, reference.topLeftCorner(kSpace, kSpace)),
            test::relativeEps(X.translation, reference.topRightCorner(kSpace, 1))};
  }
  // log of the rounded exp, against the twist it came from.
  static Worst errorOfLog(const Tangent& xi) {
    const RealMatrix exact = test::expOfMatrix(test::hat(xi));
    const Group X{exact.topLeftCorner(kSpace, kSpace).template cast<double>(),
                  exact.topRightCorner(kSpace, 1).template cast<double>()};
    const Tangent log = X.log();
    return {test::relativeEps(log.template tail<Group::kRotations>(),
                              xi.template tail<Group::kRotations>()),
            test::relativeEps(log.template head<kSpace>(), xi.template head<kSpace>())};
  }
  static double errorOfJacobian(const Tangent& xi) {
    return test::relativeEps(Group::leftJacobian(xi), test::leftJacobianByDefinition(xi));
  }

  test::Random random_{21};
};

using Groups = ::testing::Types<SE2, SE3>;
TYPED_TEST_SUITE(Accuracy, Groups);

// From a full turn, where the left Jacobian is singular [rad].
constexpr double kAway = 0.6;

double distanceToFullTurn(double angle) { return std::abs(std::remainder(angle, 2 * kPi)); }

TYPED_TEST(Accuracy, ExpWithin4EpsUpToAHalfTurn) {
  Worst worst;
  for (int i = 0; i < some(3000); ++i)
    worst.add(this->errorOfExp(this->twist(this->random_.logUniform(1e-300, kPi))));
  for (int i = 0; i < some(6000); ++i)
    worst.add(this->errorOfExp(this->twist(this->random_.uniform(0, kPi))));
  worst.expectWithin(4.0, "exp to pi");
}

TYPED_TEST(Accuracy, ExpIsAsGoodOnBothSidesOfTheSwitch) {
  Worst worst;
  const int each = some(10);
  for (int i = 0; i < 101 * each; ++i) {
    const double angle = std::sqrt(kSeriesLimit) * (1 + (i / each - 50) * kEps);
    worst.add(this->errorOfExp(this->twist(angle)));
  }
  worst.expectWithin(8.0, "exp at its switch");
}

TYPED_TEST(Accuracy, ExpWithin8EpsUpToTwoTurnsAwayFromFullOnes) {
  Worst worst;
  int away = 0;
  for (int i = 0; i < some(8000); ++i) {
    const double angle = this->random_.uniform(kPi, 4 * kPi);
    if (distanceToFullTurn(angle) < kAway) continue;
    ++away;
    worst.add(this->errorOfExp(this->twist(angle)));
  }
  ASSERT_GT(away, some(5000));
  worst.expectWithin(8.0, "exp to 4 pi");
}

TYPED_TEST(Accuracy, ExpKeepsItsRotationUpTo1e3AndAtFullTurns) {
  Worst worst;
  for (int i = 0; i < some(2000); ++i)
    worst.add(this->errorOfExp(this->twist(this->random_.uniform(4 * kPi, 1e3))));
  for (int turns = 1; turns < some(150); ++turns) {
    for (const double offset : {0.0, 1e-12, -1e-12, 1e-6, -1e-6}) {
      worst.add({this->errorOfExp(this->twist(2 * kPi * turns + offset)).rotation, 0.0});
    }
  }
  std::printf("exp to 1e3: rotation %.2f eps\n", worst.rotation);
  EXPECT_LE(worst.rotation, 8.0);
}

TYPED_TEST(Accuracy, LogWithin4EpsUpToAHalfTurn) {
  Worst worst;
  for (int i = 0; i < some(3000); ++i)
    worst.add(this->errorOfLog(this->twist(this->random_.logUniform(1e-300, 1.0))));
  for (int i = 0; i < some(6000); ++i)
    worst.add(this->errorOfLog(this->twist(this->random_.uniform(0, kPi))));
  for (int i = 0; i < some(3000); ++i) {
    worst.add(this->errorOfLog(this->twist(kPi - this->random_.logUniform(1e-12, 1e-1))));
  }
  worst.expectWithin(4.0, "log to pi - 1e-12");
}

TYPED_TEST(Accuracy, JacobiansFollowTheirSeries) {
  double worst = 0.0;
  for (int i = 0; i < some(500); ++i) {
    worst =
        std::max(worst, this->errorOfJacobian(this->twist(this->random_.logUniform(1e-300, 1.0))));
    worst = std::max(worst, this->errorOfJacobian(this->twist(this->random_.uniform(0, 4 * kPi))));
  }
  const double limit = std::sqrt(kSeriesLimit);
  for (int ulps = -50; ulps <= 50; ++ulps) {
    worst = std::max(worst, this->errorOfJacobian(this->twist(limit * (1 + ulps * kEps))));
  }
  std::printf("left Jacobian: %.2f eps\n", worst);
  EXPECT_LE(worst, 32.0);
}

// The coefficients themselves, where finite differences of exp would see nothing.

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

struct WorstCoefficient {
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
  void expectWithin(double bound) const {
    EXPECT_LE(a, bound);
    EXPECT_LE(b, bound);
    EXPECT_LE(c, bound);
    EXPECT_LE(d, bound);
    EXPECT_LE(e, bound);
    EXPECT_LE(cosine, bound);
  }
};

// Squares of angles that are measured together, and what they may be off by [eps].
struct Angles {
  const char* where;
  double bound;
  std::function<void(const std::function<void(double)>&)> each;
};

TEST(Coefficients, HoldTheirDigits) {
  test::Random random(31);
  // Of one switch from below, and from above.
  const auto below = [](double limit) {
    return [limit](const auto& measure) {
      for (int ulps = 0; ulps < 500; ++ulps) measure(limit * (1 - ulps * test::kEps));
    };
  };
  const auto above = [](double limit) {
    return [limit](const auto& measure) {
      for (int ulps = 1; ulps <= 500; ++ulps) measure(limit * (1 + ulps * test::kEps));
    };
  };
  const Angles all[] = {{"1e-300 to pi", 4,
                         [&](const auto& measure) {
                           for (int i = 0; i < 5000; ++i)
                             measure(std::pow(random.logUniform(1e-300, kPi), 2));
                           for (int i = 0; i < 5000; ++i) measure(random.uniform(0, kPi * kPi));
                         }},
                        {"to 1e3", 8,
                         [&](const auto& measure) {
                           for (int i = 0; i < 10000; ++i)
                             measure(std::pow(random.uniform(kPi, 1e3), 2));
                         }},
                        {"below the switch", 6, below(kSeriesLimit)},
                        {"above the switch", 6, above(kSeriesLimit)},
                        {"below the versine's limit", 4, below(detail::kVersineLimit)},
                        {"above the versine's limit", 4, above(detail::kVersineLimit)},
                        {"where the reduction changes quadrant", 8, [&](const auto& measure) {
                           for (int quadrant = 3; quadrant < 600; quadrant += 2) {
                             const double theta =
                                 quadrant * kPi / 2;  // h half-way between two multiples of pi/2
                             for (int ulps = -5; ulps <= 5; ++ulps) {
                               measure(std::pow(theta * (1 + ulps * test::kEps), 2));
                             }
                           }
                         }}};
  for (const Angles& angles : all) {
    SCOPED_TRACE(angles.where);
    WorstCoefficient worst;
    angles.each([&worst](double square) { worst.measure(square); });
    worst.expectWithin(angles.bound);
  }
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

TEST(Coefficients, PassNotANumberOn) { EXPECT_TRUE(std::isnan(expCoefficients(std::nan("")).a)); }

// Rotations: exp and log against their definitions.

// (x y z w) of exp(w): sin(|w| / 2) w / |w| and cos(|w| / 2).
RealMatrix expByDefinition(const Eigen::Vector3d& w) {
  const RealMatrix exact = w.cast<Real>();
  const Real angle = exact.norm(), half = angle / 2;
  RealMatrix q(4, 1);
  q.topRows(3) = exact * (angle > 0 ? Real(sin(half) / angle) : Real(0.5));
  q(3, 0) = cos(half);
  return q;
}

struct WorstRotation {
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
  void expectWithin(double bound) const {
    EXPECT_LE(entries, bound);
    EXPECT_LE(vector, bound);
    EXPECT_LE(log, bound);
  }
};

TEST(So3Accuracy, ExpAndLogWithin4EpsUpToAHalfTurnAndExpWithin8UpToTwoTurns) {
  test::Random random(43);
  WorstRotation worst, beyond;
  for (int i = 0; i < 3000; ++i) worst.add(random.logUniform(1e-300, 1.0) * random.direction<3>());
  for (int i = 0; i < 6000; ++i) worst.add(random.uniform(0, kPi) * random.direction<3>());
  for (int i = 0; i < 3000; ++i) {
    worst.add((kPi - random.logUniform(1e-12, 1e-1)) * random.direction<3>());
  }
  worst.expectWithin(4.0);
  test::Random more(44);
  for (int i = 0; i < 6000; ++i) beyond.add(more.uniform(kPi, 4 * kPi) * more.direction<3>());
  EXPECT_LE(beyond.entries, 8.0);
}

// Many angles on each side of a switch-over. The vector part of a rotation where log switches is
// half its angle, to the last bit.
TEST(So3Accuracy, ExpAndLogAreAsGoodOnBothSidesOfTheirSwitches) {
  for (const auto& [angle, seed] : {std::pair{kSo3ExpSwitch, 45U}, {2 * kSo3LogSwitch, 46U}}) {
    test::Random random(seed);
    WorstRotation below, above;
    for (int ulps = 0; ulps < 500; ++ulps) {
      const Eigen::Vector3d axis = random.direction<3>();
      const Eigen::Vector3d less = angle * (1 - (ulps + 4) * kEps) * axis,
                            more = angle * (1 + (ulps + 4) * kEps) * axis;
      below.add(less);
      above.add(more);
      EXPECT_LT(less.norm(), angle);
      EXPECT_GT(more.norm(), angle);
    }
    below.expectWithin(4.0);
    above.expectWithin(4.0);
  }
}

}  // namespace
}  // namespace helix_arm::lie
