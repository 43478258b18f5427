#include <Eigen/Geometry>

#include <gtest/gtest.h>

#include "basics/pi.hpp"
#include "helix_arm/lie/se2.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/lie/so3.hpp"
#include "support/allocation_counter.hpp"
#include "support/random.hpp"

namespace helix_arm::lie {
namespace {

using basics::kPi;

// Twists of a group, and the largest difference of two of its motions.
template <class Group>
struct Motions {
  using Tangent = typename Group::Tangent;
  static Tangent twist(double angle, test::Random& random) {
    Tangent xi;
    for (int i = 0; i < Group::kSpace; ++i) xi[i] = random.uniform(-1, 1);
    xi.template tail<Group::kRotations>() = angle * random.direction<Group::kRotations>();
    return xi;
  }
  static double distance(const Group& a, const Group& b) {
    return std::max((a.rotation - b.rotation).cwiseAbs().maxCoeff(),
                    (a.translation - b.translation).cwiseAbs().maxCoeff());
  }
};
template <>
struct Motions<SO3> {
  using Tangent = Eigen::Vector3d;
  static Tangent twist(double angle, test::Random& random) { return angle * random.direction<3>(); }
  // Of the matrices: a rotation has two quaternions.
  static double distance(const SO3& a, const SO3& b) {
    return (a.quaternion.toRotationMatrix() - b.quaternion.toRotationMatrix())
        .cwiseAbs()
        .maxCoeff();
  }
};

// The laws every group obeys, at twists of three regimes: tiny, ordinary and near a half turn.
template <class Group>
class AnyGroup : public ::testing::Test {
 protected:
  using Tangent = typename Motions<Group>::Tangent;

  Tangent twist(double angle) { return Motions<Group>::twist(angle, random_); }
  template <class Law>
  void forRandomTwists(Law law) {
    for (int i = 0; i < 500; ++i) law(twist(random_.logUniform(1e-12, 1e-3)));
    for (int i = 0; i < 500; ++i) law(twist(random_.uniform(1e-3, 3.0)));
    for (int i = 0; i < 500; ++i) law(twist(kPi - random_.logUniform(1e-9, 1e-2)));
  }
  static double distance(const Group& a, const Group& b) { return Motions<Group>::distance(a, b); }

  test::Random random_{11};
};
using AnyGroups = ::testing::Types<SO3, SE2, SE3>;
TYPED_TEST_SUITE(AnyGroup, AnyGroups);

TYPED_TEST(AnyGroup, LogInvertsExp) {
  this->forRandomTwists([](const auto& xi) {
    EXPECT_LT((TypeParam::exp(xi).log() - xi).norm(), 1e-14) << xi.transpose();
  });
}

TYPED_TEST(AnyGroup, ExpOfTheOppositeTwistIsTheInverse) {
  this->forRandomTwists([this](const auto& xi) {
    EXPECT_LT(this->distance(TypeParam::exp(-xi), TypeParam::exp(xi).inverse()), 1e-14);
    EXPECT_LT(this->distance(TypeParam::exp(xi) * TypeParam::exp(xi).inverse(), TypeParam{}),
              1e-14);
  });
}

template <class Group>
class LieGroup : public AnyGroup<Group> {};
using LieGroups = ::testing::Types<SE2, SE3>;
TYPED_TEST_SUITE(LieGroup, LieGroups);

TYPED_TEST(LieGroup, AdjointMovesTwistsBetweenFrames) {
  this->forRandomTwists([this](const auto& xi) {
    const TypeParam X_AB = TypeParam::exp(this->twist(1.3));
    EXPECT_LT(this->distance(X_AB * TypeParam::exp(xi) * X_AB.inverse(),
                             TypeParam::exp(X_AB.adjoint() * xi)),
              2e-14);
  });
}

TYPED_TEST(LieGroup, RightJacobianIsTheLeftOneSeenFromTheOtherEnd) {
  this->forRandomTwists([](const auto& xi) {
    EXPECT_LT(
        (TypeParam::exp(xi).adjoint() * TypeParam::rightJacobian(xi) - TypeParam::leftJacobian(xi))
            .norm(),
        1e-14);
  });
}

TYPED_TEST(LieGroup, JacobianInversesInvert) {
  this->forRandomTwists([](const auto& xi) {
    const auto I = TypeParam::Matrix::Identity();
    EXPECT_LT((TypeParam::leftJacobianInverse(xi) * TypeParam::leftJacobian(xi) - I).norm(), 2e-14);
    EXPECT_LT((TypeParam::rightJacobian(xi) * TypeParam::rightJacobianInverse(xi) - I).norm(),
              2e-14);
  });
}

TYPED_TEST(LieGroup, SolvingWithTheRightJacobianIsTimesItsInverse) {
  const auto expect = [this](const auto& xi) {
    const auto eta = this->twist(1.0);
    const typename TypeParam::Tangent back =
        TypeParam::rightJacobian(xi) * TypeParam::solveRightJacobian(xi, eta);
    EXPECT_LT((back - eta).norm(), 1e-13) << xi.transpose();
  };
  this->forRandomTwists(expect);
  // Both sides of the switch from the series to the quotient, and beyond a half turn.
  for (int i = 0; i < 500; ++i) expect(this->twist(std::sqrt(2.0) + (i % 2 ? 1e-9 : -1e-9)));
  for (int i = 0; i < 500; ++i) expect(this->twist(3.0 + 0.005 * i));
}

class So3 : public AnyGroup<SO3> {};

TEST_F(So3, LogIsTheSameOfBothQuaternionsOfARotation) {
  forRandomTwists([](const Eigen::Vector3d& w) {
    SO3 R = SO3::exp(w);
    R.quaternion.coeffs() *= -1.0;
    EXPECT_LT((R.log() - w).norm(), 1e-14) << w.transpose();
  });
}

TEST_F(So3, LogOfMoreThanAHalfTurnIsTheShortWayBack) {
  forRandomTwists([](const Eigen::Vector3d& w) {
    const Eigen::Vector3d other = w - 2 * kPi * w.normalized();
    EXPECT_LT((SO3::exp(other).log() - w).norm(), 1e-14) << w.transpose();
  });
}

TEST(Se2, EmbedsIntoSe3) {
  test::Random random(13);
  for (int i = 0; i < 1000; ++i) {
    const SE2::Tangent xi(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-3, 3));
    const SE3 flat = embed(SE2::exp(xi)), spatial = SE3::exp(embed(xi));
    EXPECT_LT(
        (flat.rotation - spatial.rotation).norm() + (flat.translation - spatial.translation).norm(),
        3e-15);
    EXPECT_EQ(project(embed(xi)), xi);
  }
}

// What other libraries mean by the same words, pinned once.
TEST(Convention, TwistsAreTranslationFirstAndRotationsAgreeWithEigen) {
  const Eigen::Vector3d w(0.3, -1.1, 0.7);
  Vector6 xi;
  xi << 0, 0, 0, w;
  EXPECT_LT((SE3::exp(xi).rotation - Eigen::AngleAxisd(w.norm(), w.normalized()).toRotationMatrix())
                .norm(),
            1e-15);
  xi << 0.4, 0, 0, 0, 0, 0;
  EXPECT_EQ(SE3::exp(xi).translation, Eigen::Vector3d(0.4, 0, 0));
}

template <class Group>
double useEverything(const typename Group::Tangent& xi) {
  const Group X = Group::exp(xi) * Group::exp(xi).inverse() * Group::exp(0.5 * xi);
  return X.log().sum() + X.adjoint().sum() + Group::leftJacobian(xi).sum() +
         Group::rightJacobian(xi).sum() + Group::leftJacobianInverse(xi).sum() +
         Group::rightJacobianInverse(xi).sum();
}

TEST(Lie, NeverAllocates) {
  const SE2::Tangent flat(0.4, 0.1, 0.7);
  const SE3::Tangent xi = embed(flat) + SE3::Tangent::Constant(0.01);
  const test::AllocationCounter counter;
  const double sum = useEverything<SE2>(flat) + useEverything<SE3>(xi) +
                     useEverything<SE3>(20.0 * xi) + SE3::translationJacobian(xi).sum() +
                     (SO3::exp(xi.tail<3>()) * SO3::exp(xi.head<3>()).inverse()).log().sum();
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_TRUE(std::isfinite(sum));
}

}  // namespace
}  // namespace helix_arm::lie
