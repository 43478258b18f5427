#include <gtest/gtest.h>

#include "helix_arm/basics/pi.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/lie/so3.hpp"
#include "support/random.hpp"

namespace helix_arm::lie {
namespace {

using basics::kPi;

// Largest difference of the matrices: a rotation has two quaternions.
double distance(const SO3& a, const SO3& b) {
  return (a.quaternion.toRotationMatrix() - b.quaternion.toRotationMatrix()).cwiseAbs().maxCoeff();
}

// Rotation vectors of three regimes: tiny, ordinary and near a half turn.
template <class Law>
void forRandomRotations(Law law) {
  test::Random random(41);
  const auto rotation = [&random](double angle) -> Eigen::Vector3d {
    return angle * random.direction<3>();
  };
  for (int i = 0; i < 500; ++i) law(rotation(random.logUniform(1e-12, 1e-3)));
  for (int i = 0; i < 500; ++i) law(rotation(random.uniform(1e-3, 3.0)));
  for (int i = 0; i < 500; ++i) law(rotation(kPi - random.logUniform(1e-9, 1e-2)));
}

TEST(So3, ExpOfZeroIsTheIdentityExactly) {
  EXPECT_EQ(distance(SO3::exp(Eigen::Vector3d::Zero()), SO3{}), 0.0);
  EXPECT_TRUE(SO3{}.log().isZero(0.0));
}

TEST(So3, LogInvertsExp) {
  forRandomRotations([](const Eigen::Vector3d& w) {
    EXPECT_LT((SO3::exp(w).log() - w).norm(), 1e-14) << w.transpose();
  });
}

TEST(So3, LogIsTheSameOfBothQuaternionsOfARotation) {
  forRandomRotations([](const Eigen::Vector3d& w) {
    SO3 R = SO3::exp(w);
    R.quaternion.coeffs() *= -1.0;
    EXPECT_LT((R.log() - w).norm(), 1e-14) << w.transpose();
  });
}

TEST(So3, LogOfMoreThanAHalfTurnIsTheShortWayBack) {
  forRandomRotations([](const Eigen::Vector3d& w) {
    const Eigen::Vector3d other = w - 2 * kPi * w.normalized();
    EXPECT_LT((SO3::exp(other).log() - w).norm(), 1e-14) << w.transpose();
  });
}

TEST(So3, ExpIsOfUnitLength) {
  forRandomRotations(
      [](const Eigen::Vector3d& w) { EXPECT_NEAR(SO3::exp(w).quaternion.norm(), 1.0, 1e-15); });
}

TEST(So3, ExpOfTheOppositeIsTheInverse) {
  forRandomRotations([](const Eigen::Vector3d& w) {
    EXPECT_LT(distance(SO3::exp(-w), SO3::exp(w).inverse()), 1e-14);
    EXPECT_LT(distance(SO3::exp(w) * SO3::exp(w).inverse(), SO3{}), 1e-14);
  });
}

TEST(So3, ExpIsAdditiveAlongOneAxis) {
  forRandomRotations([](const Eigen::Vector3d& w) {
    EXPECT_LT(distance(SO3::exp(0.3 * w) * SO3::exp(0.7 * w), SO3::exp(w)), 1e-14);
  });
}

TEST(So3, ProductsAreAssociative) {
  test::Random random(42);
  forRandomRotations([&random](const Eigen::Vector3d& w) {
    const SO3 R = SO3::exp(w), S = SO3::exp(random.direction<3>()),
              T = SO3::exp(2.0 * random.direction<3>());
    EXPECT_LT(distance((R * S) * T, R * (S * T)), 1e-14);
  });
}

TEST(So3, IsTheRotationOfTheRigidMotion) {
  forRandomRotations([](const Eigen::Vector3d& w) {
    Vector6 xi;
    xi << 1.0, -2.0, 0.5, w;
    EXPECT_LT((SO3::exp(w).quaternion.toRotationMatrix() - SE3::exp(xi).rotation).norm(), 1e-14);
  });
}

TEST(So3, NormalizingRemovesTheRoundingOfManyProducts) {
  const SO3 step = SO3::exp({0.3, -0.2, 0.1});
  SO3 R;
  for (int i = 0; i < 100000; ++i) R = R * step;
  EXPECT_NEAR(R.normalized().quaternion.norm(), 1.0, 1e-15);
  EXPECT_LT((R.normalized().log() - R.log()).norm(), 1e-14);
}

}  // namespace
}  // namespace helix_arm::lie
