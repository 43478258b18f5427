#include "helix_arm/regulator/simulated_regulator.hpp"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

namespace helix_arm::regulator {
namespace {

constexpr double kTau = 0.1, kSupply = 5e5;
const SimulatedRegulatorConfig kQuiet{kTau, kSupply, 0.0, 1};

TEST(SimulatedRegulator, AStepIsAnsweredByTheExponentialOfItsLag) {
  for (const double t : {1e-9, 1e-3, 0.05, 0.1, 0.5, 3.0}) {
    SimulatedRegulator regulator(1, kQuiet);
    regulator.command(Eigen::VectorXd::Constant(1, 2e5));
    regulator.step(t);
    const long double expected = 2e5L * -std::expm1(-static_cast<long double>(t) / kTau);
    EXPECT_NEAR(regulator.pressure()[0] / static_cast<double>(expected), 1.0, 1e-15) << t;
  }
}

TEST(SimulatedRegulator, AirMayLeaveMoreSlowlyThanItEnters) {
  SimulatedRegulatorConfig config = kQuiet;
  config.fall_time_constant = 0.3;
  SimulatedRegulator regulator(2, config);
  regulator.command(Eigen::Vector2d(2e5, 1e5));
  regulator.step(100 * kTau);
  regulator.command(Eigen::Vector2d(0, 3e5));
  regulator.step(0.15);
  EXPECT_NEAR(regulator.pressure()[0], 2e5 * std::exp(-0.15 / 0.3), 1e-6);
  EXPECT_NEAR(regulator.pressure()[1], 3e5 - 2e5 * std::exp(-0.15 / kTau), 1e-6);
}

TEST(SimulatedRegulator, SetPointsHaveAnEffectAfterTheDeadTimeWhateverTheSteps) {
  SimulatedRegulatorConfig config = kQuiet;
  config.dead_time = 0.03;
  for (const double step : {0.001, 0.0071, 0.1, 1.0}) {
    SimulatedRegulator regulator(1, config);
    const auto goOn = [&](double time) {
      for (double left = time; left > 1e-12; left -= step) regulator.step(std::min(step, left));
    };
    regulator.command(Eigen::VectorXd::Constant(1, 1e5));
    regulator.command(Eigen::VectorXd::Constant(1, 2e5));  // the last one of an instant counts
    goOn(0.02);
    regulator.command(Eigen::VectorXd::Constant(1, 0));
    EXPECT_EQ(regulator.pressure()[0], 0) << step;
    goOn(0.08);
    // 0.03: rises for 0.02 s, then falls for 0.05 s.
    const double top = 2e5 * -std::expm1(-0.02 / kTau);
    EXPECT_NEAR(regulator.pressure()[0], top * std::exp(-0.05 / kTau), 1e-6) << step;
  }
}

// What a fault makes of pressures that stood at 100 and 200 kPa and are to go to 300 kPa, in the
// end.
Eigen::VectorXd endUnder(AirFault fault) {
  SimulatedRegulator regulator(2, kQuiet);
  regulator.command(Eigen::Vector2d(1e5, 2e5));
  regulator.step(100 * kTau);
  regulator.fail(fault);
  regulator.command(Eigen::Vector2d(3e5, 3e5));
  regulator.step(100 * kTau);
  return regulator.pressure();
}

TEST(SimulatedRegulator, AFaultIsOfTheFirstChannelOrOfTheSupply) {
  EXPECT_EQ(endUnder(AirFault::kNone), Eigen::Vector2d(3e5, 3e5));
  EXPECT_TRUE(endUnder(AirFault::kBurst).isApprox(Eigen::Vector2d(0, 3e5)));
  EXPECT_TRUE(endUnder(AirFault::kStuckOpen).isApprox(Eigen::Vector2d(kSupply, 3e5)));
  EXPECT_TRUE(endUnder(AirFault::kStuckShut).isApprox(Eigen::Vector2d(1e5, 3e5)));
}

TEST(SimulatedRegulator, UnderAWeakSupplyPressuresStayOrFallButDoNotRiseAboveIt) {
  SimulatedRegulator regulator(3, kQuiet);
  regulator.command(Eigen::Vector3d(1e5, 2e5, 0));
  regulator.step(100 * kTau);
  regulator.fail(AirFault::kLowSupply);
  EXPECT_EQ(regulator.supply(), 0.1 * kSupply);
  regulator.command(Eigen::Vector3d(3e5, 1e5, 3e5));
  regulator.step(100 * kTau);
  EXPECT_TRUE(regulator.pressure().isApprox(Eigen::Vector3d(1e5, 1e5, 0.1 * kSupply)));
}

}  // namespace
}  // namespace helix_arm::regulator
