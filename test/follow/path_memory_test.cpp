#include "follow/path_memory.hpp"

#include <cmath>

#include <gtest/gtest.h>

#include "basics/pi.hpp"
#include "support/random.hpp"

namespace helix_arm::follow {
namespace {

constexpr double kRadius = 0.02, kPeriod = 8.0, kSpacing = 1.0 / 30, kReach = 0.005;  // [m], [s]
constexpr int kTurn = static_cast<int>(kPeriod / kSpacing);                           // pictures

// A circle, and a tip that misses it by what depends on the place and the sense of the motion.
class Circle {
 public:
  explicit Circle(double noise) : noise_(noise) {}

  // RMS over one turn of the tip, without the noise of its pictures [m].
  double turn(double sense, double error) {
    double sum2 = 0;
    for (int k = 0; k < kTurn; ++k, time_ += kSpacing) {
      const double angle = sense * 2 * basics::kPi * k / kTurn;
      const Eigen::Vector3d place = kRadius * Eigen::Vector3d(0, std::cos(angle), std::sin(angle));
      const Eigen::Vector3d velocity =
          sense * 2 * basics::kPi / kPeriod * Eigen::Vector3d(0, -place.z(), place.y());
      const Eigen::Vector3d missed =
          memory.at(place, velocity, kReach) +
          error * Eigen::Vector3d(sense, std::cos(2 * angle), std::sin(angle));
      sum2 += missed.squaredNorm();
      const Eigen::Vector3d seen(random_.normal(), random_.normal(), random_.normal());
      memory.add(time_, place, velocity, kReach, missed + noise_ * seen);
    }
    return std::sqrt(sum2 / kTurn);
  }

  PathMemory memory;

 private:
  const double noise_;
  test::Random random_{5};
  double time_ = 0;
};

TEST(PathMemory, HalvesWithEachTurnWhatRepeats) {
  Circle circle(0.0005);
  double before = circle.turn(1, 0.002);
  EXPECT_GT(before, 0.002);
  for (int turn = 0; turn < 3; ++turn) {
    const double now = circle.turn(1, 0.002);
    EXPECT_LT(now, 0.75 * before) << turn;
    before = now;
  }
  circle.memory.clear();
  EXPECT_GT(circle.turn(1, 0.002), 0.002);
}

TEST(PathMemory, TellsTheSensesOfAPathApart) {
  Circle circle(0);
  for (int turn = 0; turn < 3; ++turn) circle.turn(1, 0.002);
  Circle fresh(0);
  EXPECT_NEAR(circle.turn(-1, 0.002), fresh.turn(-1, 0.002), 1e-4);
}

}  // namespace
}  // namespace helix_arm::follow
