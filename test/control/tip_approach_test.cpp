#include <Eigen/Geometry>
#include <limits>

#include <gtest/gtest.h>

#include "helix_arm/control/tip_path.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "support/allocation_counter.hpp"
#include "support/random.hpp"

namespace helix_arm::control {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

const double kNan = std::nan("");
const double kInfinity = std::numeric_limits<double>::infinity();

TEST(TipApproach, CoversTheLineWithTheLeastJerkPolynomial) {
  const Vector3d from(0.3, 0.1, -0.1), to(0.35, -0.05, 0.05);
  const TipApproach approach(from, to);
  const double T = approach.duration();
  for (int i = 0; i <= 1000; ++i) {
    const double s = 1e-3 * i;
    const double covered = 10 * std::pow(s, 3) - 15 * std::pow(s, 4) + 6 * std::pow(s, 5);
    const double rate = 30 * std::pow(s, 2) - 60 * std::pow(s, 3) + 30 * std::pow(s, 4);
    const TipReference reference = approach.at(s * T);
    EXPECT_LT((reference.position - (from + covered * (to - from))).norm(), 1e-15);
    EXPECT_LT((reference.velocity - rate / T * (to - from)).norm(), 1e-14);
    EXPECT_FALSE(reference.rotation);
  }
}

TEST(TipApproach, ReachesExactlyItsLargestSpeedHalfWay) {
  test::Random random(1);
  for (const double most_speed : {kApproachSpeed, 0.02, 3.0}) {
    const Vector3d from = random.direction<3>(), to = random.direction<3>();
    const TipApproach approach(from, to, most_speed);
    double largest = 0;
    for (int i = 0; i <= 1000; ++i) {
      largest = std::max(largest, approach.at(1e-3 * i * approach.duration()).velocity.norm());
    }
    EXPECT_NEAR(largest, most_speed, 1e-12);
    EXPECT_NEAR(approach.at(0.5 * approach.duration()).velocity.norm(), most_speed, 1e-12);
  }
  EXPECT_EQ(TipApproach(Vector3d(0, 0, 0), Vector3d(0.1, 0, 0)).duration(), 1.875);
}

TEST(TipApproach, RestsAtBothEndsBeforeAndAfter) {
  const Vector3d from(1, 2, 3), to(1.1, 2, 3);
  const TipApproach approach(from, to);
  for (const double t : {-kInfinity, -1.0, 0.0, kNan}) {
    EXPECT_EQ(approach.at(t).position, from) << t;
    EXPECT_EQ(approach.at(t).velocity, Vector3d(0, 0, 0)) << t;
  }
  for (const double t : {approach.duration(), approach.duration() + 1, kInfinity}) {
    EXPECT_EQ(approach.at(t).position, to) << t;
    EXPECT_EQ(approach.at(t).velocity, Vector3d(0, 0, 0)) << t;
  }
}

TEST(TipApproach, TakesNoTimeWhereThePathBegins) {
  const Vector3d place(0.3, 0, 0);
  const TipApproach approach(place, place);
  EXPECT_EQ(approach.duration(), 0.0);
  for (const double t : {-1.0, 0.0, 1.0, kNan}) {
    EXPECT_EQ(approach.at(t).position, place) << t;
    EXPECT_EQ(approach.at(t).velocity, Vector3d(0, 0, 0)) << t;
  }
}

TEST(TipApproach, BetweenPosesItTurnsAboutOneAxisAndNoFasterThanItMoves) {
  const Vector3d axis = Vector3d(1, 2, -1).normalized();
  const Matrix3d start = Eigen::AngleAxisd(0.7, Vector3d(0, 1, 0)).toRotationMatrix();
  const lie::SE3 from{start, {0.3, 0, 0}};
  const lie::SE3 to{Eigen::AngleAxisd(2.5, axis).toRotationMatrix() * start, {0.31, 0, 0}};
  const TipApproach approach(from, to);
  const double most_rate = kApproachSpeed / statics::InverseOptions().rotation_weight;
  EXPECT_NEAR(approach.duration(), 1.875 * 2.5 / most_rate, 1e-12);
  for (int i = 0; i <= 100; ++i) {
    const double s = 0.01 * i;
    const double covered = 10 * std::pow(s, 3) - 15 * std::pow(s, 4) + 6 * std::pow(s, 5);
    const double rate = 30 * std::pow(s * (1 - s), 2) / approach.duration();
    const TipReference reference = approach.at(s * approach.duration());
    const Matrix3d expected = Eigen::AngleAxisd(2.5 * covered, axis).toRotationMatrix() * start;
    EXPECT_LT((*reference.rotation - expected).norm(), 1e-14);
    EXPECT_LT((reference.angular_velocity - 2.5 * rate * axis).norm(), 1e-14);
  }
  // A position that is far and a small turn: the speed decides.
  EXPECT_NEAR(TipApproach(from, lie::SE3{start, {0.5, 0, 0}}).duration(), 1.875 * 0.2 / 0.1, 1e-12);
}

TEST(TipApproach, IsAskedWithoutAllocations) {
  const lie::SE3 to{Eigen::AngleAxisd(1.0, Vector3d(0, 1, 0)).toRotationMatrix(), {1, 0, 0}};
  const TipApproach approach(lie::SE3(), to);
  static_assert(noexcept(approach.at(0.0)));
  const test::AllocationCounter counter;
  double sum = 0;
  for (int i = -10; i < 1000; ++i) sum += approach.at(0.1 * i).rotation->sum();
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_TRUE(std::isfinite(sum));
}

}  // namespace
}  // namespace helix_arm::control
