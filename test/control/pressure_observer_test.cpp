#include "helix_arm/control/pressure_observer.hpp"

#include <limits>

#include <gtest/gtest.h>

#include "support/allocation_counter.hpp"
#include "support/random.hpp"

namespace helix_arm::control {
namespace {

constexpr double kLag = 0.15;     // [s]
constexpr double kNoise = 5e3;    // [Pa]
constexpr double kPeriod = 0.01;  // [s]

Eigen::VectorXd one(double value) { return Eigen::VectorXd::Constant(1, value); }

// A channel whose set point changes every second.
struct Channel {
  double pressure = 0.0, set_point = 0.0, time = 0.0;
  void step(double dt) {
    time += dt;
    set_point = static_cast<int>(time) % 2 == 0 ? 3e5 : 1e5;
    pressure += -std::expm1(-dt / kLag) * (set_point - pressure);
  }
};

TEST(PressureObserver, FollowsTheLagBetterThanItsReadings) {
  test::Random random(1);
  PressureObserver observer(1, kLag, kNoise);
  Channel channel;
  double error2 = 0, nees = 0;
  constexpr int kTurns = 6000;
  for (int k = 0; k < kTurns; ++k) {
    channel.step(kPeriod);
    observer.update(channel.time, one(channel.set_point),
                    one(channel.pressure + kNoise * random.normal()));
    const double error = observer.newest().pressure[0] - channel.pressure;
    error2 += error * error / kTurns;
    nees += error * error / observer.newest().variance[0] / kTurns;
  }
  EXPECT_LT(std::sqrt(error2), 0.3 * kNoise);
  EXPECT_GT(nees, 0.1);
  EXPECT_LT(nees, 1.5);
}

// What is said of a time to come is what the observer says then, if no reading comes.
TEST(PressureObserver, LooksAheadAlongTheLag) {
  constexpr double kAhead = 0.12;  // [s]
  const Eigen::VectorXd none = one(std::numeric_limits<double>::quiet_NaN());
  PressureObserver observer(1, kLag, kNoise);
  PressureObserver::Estimate ahead;
  EXPECT_FALSE(observer.ahead(0.0, ahead));
  observer.update(0.0, one(0), one(1e4));
  ASSERT_TRUE(observer.ahead(0.049, ahead));
  EXPECT_EQ(ahead.pressure[0], 1e4) << "no set point is known yet";
  EXPECT_FALSE(observer.ahead(0.051, ahead));
  observer.update(0.2, one(2e5), one(1.5e5));
  EXPECT_FALSE(observer.ahead(0.199, ahead));
  EXPECT_TRUE(observer.ahead(0.499, ahead));
  EXPECT_FALSE(observer.ahead(0.501, ahead)) << "one and a half periods";
  ASSERT_TRUE(observer.ahead(0.2 + kAhead, ahead));
  observer.update(0.2 + kAhead, one(2e5), none);
  EXPECT_EQ(ahead.pressure, observer.newest().pressure);
  EXPECT_EQ(ahead.variance, observer.newest().variance);
  EXPECT_GT(ahead.pressure[0], 1.6e5);
  observer.update(5.0, one(2e5), one(2e5));
  EXPECT_TRUE(observer.ahead(5.999, ahead));
  EXPECT_FALSE(observer.ahead(6.001, ahead)) << "no longer than it remembers";
}

// Such numbers come of damaged messages; their squares are infinite.
TEST(PressureObserver, IgnoresWhatIsNoPressure) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  for (const double wrong :
       {1e300, -1e300, 1.01e8, -2.01e5, kInfinity, std::numeric_limits<double>::quiet_NaN()}) {
    PressureObserver observer(1, kLag, kNoise);
    observer.update(0.0, one(0), one(wrong));
    EXPECT_FALSE(observer.started());
    for (int k = 1; k <= 100; ++k) observer.update(k * kPeriod, one(1e5), one(1e5));
    observer.update(1.01, one(wrong), one(1e5));
    observer.update(1.02, one(1e5), one(wrong));
    EXPECT_NEAR(observer.newest().pressure[0], 1e5, 1.0) << wrong;
    EXPECT_LT(observer.newest().variance[0], kNoise * kNoise);
  }
}

TEST(PressureObserver, AllocatesNothing) {
  PressureObserver observer(3, kLag, kNoise);
  const Eigen::VectorXd reading = Eigen::VectorXd::Constant(3, 1e5);
  PressureObserver::Estimate at{reading, reading};
  observer.update(0.0, reading, reading);
  const test::AllocationCounter counter;
  for (int k = 1; k < 3000; ++k) {
    observer.update(k * kPeriod, reading, reading);
    observer.at((k - 0.5) * kPeriod, at);
  }
  EXPECT_EQ(counter.count(), 0u);
}

}  // namespace
}  // namespace helix_arm::control
