// exp, log and the Jacobians against their definitions in 80 digits.
#include <cmath>
#include <cstdio>

#include <gtest/gtest.h>

#include "basics/pi.hpp"
#include "helix_arm/lie/se2.hpp"
#include "helix_arm/lie/se3.hpp"
#include "lie/coefficients.hpp"
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

}  // namespace
}  // namespace helix_arm::lie
