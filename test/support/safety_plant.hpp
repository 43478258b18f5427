#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "helix_arm/control/safety.hpp"
#include "support/random.hpp"

namespace helix_arm::test {

/// Rules of a core.
struct GivenRules {
  control::SafetyRules rules;
  std::vector<control::ChannelRules> channels;
};

inline GivenRules randomRules(Random& random) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  GivenRules given;
  control::SafetyRules& rules = given.rules;
  rules.target_timeout = random.integer(0, 5) == 0 ? kInfinity : random.logUniform(0.05, 3);
  rules.reading_timeout = random.logUniform(0.1, 2);
  rules.trip_margin = random.uniform(1.5e4, 6e4);
  rules.spike_time = random.integer(0, 5) == 0 ? 0 : random.logUniform(0.01, 0.5);
  if (random.integer(0, 1) == 0) rules.min_supply = random.uniform(1e5, 4e5);
  rules.follow_tolerance = random.logUniform(2e4, 2e5);
  rules.follow_time = random.logUniform(0.1, 2);
  rules.time_constant = random.logUniform(0.05, 0.5);
  rules.leak_drop = random.logUniform(1e4, 1e5);
  rules.hold_time = random.integer(0, 5) == 0 ? 0 : random.logUniform(0.1, 5);
  rules.vented_below = random.uniform(5e3, 1.4e4);
  rules.vent_time = random.logUniform(0.5, 5);
  const int count = random.integer(1, 6);
  for (int i = 0; i < count; ++i) {
    const double lower = std::array<double, 3>{0, 5e4, -6e4}[random.integer(0, 2)];
    given.channels.push_back({"muscle_" + std::to_string(i + 1),
                              {lower, lower + random.uniform(0, 4e5)},
                              random.integer(0, 3) == 0 ? kInfinity : random.logUniform(1e4, 3e6),
                              static_cast<control::FaultAction>(random.integer(0, 2))});
  }
  return given;
}

/// A regulator that does as told, until something happens to it.
struct SafetyPlant {
  enum class Ill { kNo, kBurst, kStuckSensor, kUnread, kStuckValve };

  SafetyPlant(int channels, Random& source)
      : random(source),
        pressure(Eigen::VectorXd::Zero(channels)),
        stuck_at(pressure),
        ill(static_cast<std::size_t>(channels), Ill::kNo),
        lag(random.uniform(0.05, 0.3)),
        noise(random.integer(0, 1) == 0 ? 0 : 3e3) {}

  void step(double dt, const control::ValveOrders& orders) {
    for (int i = 0; i < pressure.size(); ++i) {
      const Ill what = ill[i];
      double towards = orders.set_point[i], time = lag;
      if (what == Ill::kBurst) towards = 0, time = 0.02;
      if (what == Ill::kStuckValve) towards = 5.5e5, time = 0.5;
      if (orders.valve[i] == control::Valve::kClose && what != Ill::kBurst) continue;
      pressure[i] += -std::expm1(-dt / time) * (towards - pressure[i]);
    }
  }
  void mishap() {
    const int i = random.integer(0, static_cast<int>(pressure.size()) - 1);
    ill[i] = random.integer(0, 2) == 0 ? static_cast<Ill>(random.integer(1, 4)) : Ill::kNo;
    stuck_at[i] = pressure[i];
  }
  Eigen::VectorXd read() {
    Eigen::VectorXd reading = pressure;
    for (int i = 0; i < reading.size(); ++i) {
      if (ill[i] == Ill::kStuckSensor) reading[i] = stuck_at[i];
      reading[i] += noise * random.normal();
      if (ill[i] == Ill::kUnread || random.integer(0, 199) == 0) reading[i] = std::nan("");
    }
    return reading;
  }

  Random& random;
  Eigen::VectorXd pressure, stuck_at;
  std::vector<Ill> ill;
  double lag, noise;
};

}  // namespace helix_arm::test
