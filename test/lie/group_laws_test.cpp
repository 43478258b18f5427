#include <Eigen/Geometry>
#include <Eigen/LU>

#include <gtest/gtest.h>

#include "helix_arm/basics/pi.hpp"
#include "helix_arm/lie/se2.hpp"
#include "helix_arm/lie/se3.hpp"
#include "support/random.hpp"

namespace helix_arm::lie {
namespace {

using basics::kPi;

// The laws every Lie group obeys, at twists of three regimes: tiny, ordinary and near a half turn.
template <class Group>
class LieGroup : public ::testing::Test {
 protected:
  using Tangent = typename Group::Tangent;

  Tangent twist(double angle) {
    Tangent xi;
    for (int i = 0; i < Group::kSpace; ++i) xi[i] = random_.uniform(-1, 1);
    const auto axis = random_.direction<Group::kRotations>();
    xi.template tail<Group::kRotations>() = angle * axis;
    return xi;
  }
  double angleOf(const Tangent& xi) { return xi.template tail<Group::kRotations>().norm(); }

  template <class Law>
  void forRandomTwists(Law law) {
    for (int i = 0; i < 500; ++i) law(twist(random_.logUniform(1e-12, 1e-3)));
    for (int i = 0; i < 500; ++i) law(twist(random_.uniform(1e-3, 3.0)));
    for (int i = 0; i < 500; ++i) law(twist(kPi - random_.logUniform(1e-9, 1e-2)));
  }
  static double distance(const Group& a, const Group& b) {
    return std::max((a.rotation - b.rotation).cwiseAbs().maxCoeff(),
                    (a.translation - b.translation).cwiseAbs().maxCoeff());
  }

  test::Random random_{11};
};

using Groups = ::testing::Types<SE2, SE3>;
TYPED_TEST_SUITE(LieGroup, Groups);

TYPED_TEST(LieGroup, ExpOfZeroIsTheIdentityExactly) {
  const TypeParam X = TypeParam::exp(TypeParam::Tangent::Zero());
  EXPECT_EQ(this->distance(X, TypeParam{}), 0.0);
  EXPECT_TRUE(TypeParam{}.log().isZero(0.0));
}

TYPED_TEST(LieGroup, LogInvertsExp) {
  this->forRandomTwists([](const auto& xi) {
    EXPECT_LT((TypeParam::exp(xi).log() - xi).norm(), 1e-14) << xi.transpose();
  });
}

TYPED_TEST(LieGroup, RotationsOfExpAreOrthogonal) {
  this->forRandomTwists([](const auto& xi) {
    const auto R = TypeParam::exp(xi).rotation;
    EXPECT_LT((R * R.transpose() - R.Identity()).norm(), 2e-15);
    EXPECT_NEAR(R.determinant(), 1.0, 2e-15);
  });
}

TYPED_TEST(LieGroup, ExpOfTheOppositeTwistIsTheInverse) {
  this->forRandomTwists([this](const auto& xi) {
    EXPECT_LT(this->distance(TypeParam::exp(-xi), TypeParam::exp(xi).inverse()), 1e-14);
    EXPECT_LT(this->distance(TypeParam::exp(xi) * TypeParam::exp(xi).inverse(), TypeParam{}),
              1e-14);
  });
}

TYPED_TEST(LieGroup, ExpIsAdditiveAlongOneTwist) {
  this->forRandomTwists([this](const auto& xi) {
    EXPECT_LT(
        this->distance(TypeParam::exp(0.3 * xi) * TypeParam::exp(0.7 * xi), TypeParam::exp(xi)),
        1e-14);
  });
}

TYPED_TEST(LieGroup, ProductsAreAssociativeAndActOnPoints) {
  this->forRandomTwists([this](const auto& xi) {
    const TypeParam X = TypeParam::exp(xi), Y = TypeParam::exp(this->twist(1.0)),
                    Z = TypeParam::exp(this->twist(2.0));
    EXPECT_LT(this->distance((X * Y) * Z, X * (Y * Z)), 1e-14);
    const typename TypeParam::Point p = this->twist(0.5).template head<TypeParam::kSpace>();
    EXPECT_LT(((X * Y) * p - X * (Y * p)).norm(), 1e-14);
  });
}

TYPED_TEST(LieGroup, AdjointMovesTwistsBetweenFrames) {
  this->forRandomTwists([this](const auto& xi) {
    const TypeParam X_AB = TypeParam::exp(this->twist(1.3));
    EXPECT_LT(this->distance(X_AB * TypeParam::exp(xi) * X_AB.inverse(),
                             TypeParam::exp(X_AB.adjoint() * xi)),
              2e-14);
  });
}

TYPED_TEST(LieGroup, AdjointOfAProductIsTheProductOfAdjoints) {
  this->forRandomTwists([this](const auto& xi) {
    const TypeParam X = TypeParam::exp(xi), Y = TypeParam::exp(this->twist(0.8));
    EXPECT_LT(((X * Y).adjoint() - X.adjoint() * Y.adjoint()).norm(), 1e-14);
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

TYPED_TEST(LieGroup, LeftJacobianMovesATwistToTheFrontOfExp) {
  // First order only: what is left must fall with the square of the step.
  this->forRandomTwists([this](const auto& xi) {
    const auto d = this->twist(1.0);
    const auto gap = [&](double step) {
      return this->distance(
          TypeParam::exp(xi + step * d),
          TypeParam::exp(TypeParam::leftJacobian(xi) * (step * d)) * TypeParam::exp(xi));
    };
    EXPECT_LT(gap(1e-3), 1e-5);
    EXPECT_LT(gap(1e-5), 1e-9);
  });
}

TEST(Se3, TranslationJacobianIsTheRightJacobianTurnedIntoTheBaseFrame) {
  test::Random random(12);
  for (int i = 0; i < 2000; ++i) {
    Vector6 xi;
    xi << random.direction<3>(), random.uniform(0, 12) * random.direction<3>();
    const Eigen::Matrix<double, 3, 6> expected =
        SE3::exp(xi).rotation * SE3::rightJacobian(xi).topRows<3>();
    EXPECT_LT((SE3::translationJacobian(xi) - expected).norm(), 3e-14) << xi.transpose();
  }
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

TEST(Convention, PositiveCurvatureAboutZBendsTowardsY) {
  EXPECT_GT(SE2::exp({0.4, 0, 0.5}).translation.y(), 0.05);
}

}  // namespace
}  // namespace helix_arm::lie
