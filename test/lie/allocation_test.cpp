#include <gtest/gtest.h>

#include "helix_arm/lie/se2.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/lie/so3.hpp"
#include "support/allocation_counter.hpp"

namespace helix_arm::lie {
namespace {

TEST(AllocationCounter, SeesWhatEigenAllocates) {
  const test::AllocationCounter counter;
  const Eigen::VectorXd vector = Eigen::VectorXd::Zero(100);
  EXPECT_EQ(vector.sum(), 0.0);
  EXPECT_GE(counter.count(), 1u);
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
