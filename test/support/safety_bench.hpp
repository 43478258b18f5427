#pragma once

#include <cmath>
#include <functional>
#include <utility>

#include <gtest/gtest.h>

#include "helix_arm/control/safety.hpp"

namespace helix_arm::test {

/// A power of two, so that sums of turns meet the ends of timers exactly [s].
inline constexpr double kTurn = 1.0 / 64;

/// Rules whose times are whole turns.
inline control::SafetyRules benchRules() {
  control::SafetyRules rules;
  rules.target_timeout = 1;
  rules.reading_timeout = 0.5;
  rules.trip_margin = 3e4;
  rules.spike_time = 0.125;
  rules.min_supply = 3.5e5;
  rules.follow_tolerance = 4e4;
  rules.follow_time = 1;
  rules.time_constant = 0.25;
  rules.leak_drop = 2.5e4;
  rules.hold_time = 8;
  rules.vented_below = 1e4;
  rules.vent_time = 3;
  return rules;
}

/// One channel of each fault action, in their order.
inline std::vector<control::ChannelRules> benchChannels(double slew = 1e6) {
  return {{"vents", {0, 4e5}, slew, control::FaultAction::kVent},
          {"holds", {0, 4e5}, slew, control::FaultAction::kHold},
          {"closes", {0, 4e5}, slew, control::FaultAction::kClose}};
}

/// A safety core on channels that are healthy first-order lags, until `spoil` says otherwise.
struct Bench {
  explicit Bench(const control::SafetyRules& rules = benchRules(),
                 std::vector<control::ChannelRules> channels = benchChannels())
      : core(std::move(channels), rules),
        pressure(Eigen::VectorXd::Zero(static_cast<Eigen::Index>(core.channels().size()))),
        goal(Eigen::VectorXd::Constant(pressure.size(), 1e5)) {}

  control::SafetyCore core;
  double now = 1000;
  Eigen::VectorXd pressure;                     ///< true ones, gauge [Pa]
  Eigen::VectorXd goal;                         ///< of the targets [Pa]
  bool commands = true;                         ///< a target every turn
  bool reads = true;                            ///< a reading every turn
  double supply = 5e5;                          ///< gauge [Pa]
  std::function<void(Eigen::VectorXd&)> spoil;  ///< what the sensors make of the pressures

  control::SafetyState state() const { return core.state(); }
  control::SafetyCause cause() const { return core.report().cause; }

  Bench& turn(double dt = kTurn) {
    now += dt;
    const control::ValveOrders& orders = core.orders();
    for (int i = 0; i < pressure.size(); ++i) {
      if (orders.valve[i] == control::Valve::kClose) continue;
      pressure[i] +=
          -std::expm1(-dt / core.rules().time_constant) * (orders.set_point[i] - pressure[i]);
    }
    Eigen::VectorXd reading = pressure;
    if (spoil) spoil(reading);
    if (reads) core.measured(now, reading, supply);
    if (commands) core.target(now, goal);
    core.advance(now);
    return *this;
  }
  Bench& turns(int count) {
    for (int k = 0; k < count; ++k) turn();
    return *this;
  }
  Bench& run(double time) { return turns(static_cast<int>(std::lround(time / kTurn))); }
  /// Reads once and is enabled.
  Bench& start() {
    turn();
    EXPECT_EQ(core.enable(now), "");
    return *this;
  }
  /// Until it is in a state, for 10 s at most.
  bool reach(control::SafetyState wanted) {
    for (int k = 0; k < 640 && state() != wanted; ++k) turn();
    return state() == wanted;
  }

  /// A letter a channel: v it vents, r it regulates, c it is closed.
  std::string orders() const {
    std::string letters;
    for (const control::Valve valve : core.orders().valve) {
      letters += "vrc"[static_cast<int>(valve)];
    }
    return letters;
  }

  // What is different from now on.
  Bench& readsOff(int channel, double offset) {
    spoil = [=](Eigen::VectorXd& reading) { reading[channel] += offset; };
    return *this;
  }
  Bench& readsAs(int channel, double value) {
    spoil = [=](Eigen::VectorXd& reading) { reading[channel] = value; };
    return *this;
  }
  Bench& readsTrue() { return spoil = nullptr, *this; }
  Bench& silent() { return commands = false, *this; }
  Bench& unread() { return reads = false, *this; }
  Bench& supplied(double gauge) { return supply = gauge, *this; }
};

/// Enabled, and at its goal [Pa] for so long that it reads it to the last digit.
inline Bench enabledBench(double goal = 1e5,
                          std::vector<control::ChannelRules> channels = benchChannels()) {
  Bench bench(benchRules(), std::move(channels));
  bench.goal.setConstant(goal);
  bench.start().run(12);
  EXPECT_EQ(bench.state(), control::SafetyState::kEnabled);
  return bench;
}

}  // namespace helix_arm::test
