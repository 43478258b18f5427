#include <algorithm>
#include <array>
#include <set>
#include <utility>

#include <gtest/gtest.h>

#include "helix_arm/control/safety.hpp"
#include "support/random.hpp"

namespace helix_arm::control {
namespace {

using State = SafetyState;
using Cause = SafetyCause;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kRuns = 400;
constexpr int kTurns = 4000;

// Rules of a core.
struct GivenRules {
  SafetyRules rules;
  std::vector<ChannelRules> channels;
};

GivenRules randomRules(test::Random& random) {
  GivenRules given;
  SafetyRules& rules = given.rules;
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
                              static_cast<FaultAction>(random.integer(0, 2))});
  }
  return given;
}

// A regulator that does as told, until something happens to it.
struct Plant {
  enum class Ill { kNo, kBurst, kStuckSensor, kUnread, kStuckValve };

  Plant(int channels, test::Random& source)
      : random(source),
        pressure(Eigen::VectorXd::Zero(channels)),
        stuck_at(pressure),
        ill(static_cast<std::size_t>(channels), Ill::kNo),
        lag(random.uniform(0.05, 0.3)),
        noise(random.integer(0, 1) == 0 ? 0 : 3e3) {}

  void step(double dt, const ValveOrders& orders) {
    for (int i = 0; i < pressure.size(); ++i) {
      const Ill what = ill[i];
      double towards = orders.set_point[i], time = lag;
      if (what == Ill::kBurst) towards = 0, time = 0.02;
      if (what == Ill::kStuckValve) towards = 5.5e5, time = 0.5;
      if (orders.valve[i] == Valve::kClose && what != Ill::kBurst) continue;
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

  test::Random& random;
  Eigen::VectorXd pressure, stuck_at;
  std::vector<Ill> ill;
  double lag, noise;
};

// How long something has been so on every look.
struct Spell {
  double since = kInfinity;
  void look(double now, bool so) { since = so ? std::min(since, now) : kInfinity; }
  double lasted(double now) const { return std::isinf(since) ? -1 : now - since; }
};

// What anyone who sees the calls and the answers can hold against the core: none of its own numbers
// but the rules.
struct Witness {
  Witness(const SafetyCore& watched, const GivenRules& all)
      : core(watched),
        given(all),
        read_at(all.channels.size(), -kInfinity),
        empty_at(all.channels.size(), -kInfinity),
        over(all.channels.size()),
        was_inside(all.channels.size(), false) {}

  int count() const { return static_cast<int>(given.channels.size()); }
  // That a set point may move since the last turn.
  double stepOf(int i) const {
    const double slew = given.channels[i].slew;
    return std::isinf(slew) ? kInfinity : slew * std::min(now - order_at, 0.1);
  }

  // After any call; `enabling` where it was an enable that was not refused.
  void look(bool enabling, bool grave) {
    const State state = core.state();
    if (state != before) {
      edges.emplace(before, state);
      ASSERT_TRUE(state != State::kEnabled || enabling);
      if (state == State::kDisabled) restEnded();
      resting = false;
      if (state == State::kFault) {
        fault_at = now;
        was_held.assign(given.channels.size(), true);
        causes.insert(core.report().cause);
      }
    }
    ASSERT_EQ(enabling, state == State::kEnabled && before != State::kEnabled);
    before = state;
    if (enabling) barred = false;
    const Cause cause = core.report().cause;
    const bool passes = cause == Cause::kNone || cause == Cause::kStaleTarget ||
                        cause == Cause::kStaleReading || cause == Cause::kRegulatorLost;
    const bool at_rest = state == State::kDisabled || state == State::kVented;
    ASSERT_TRUE(!core.mayEnableItself() || (at_rest && passes && !barred)) << core.reason();
    if (state != State::kVented || !passes) return lookAtOrders(grave);
    ++(barred ? barred_turns : passed_turns);
    lookAtOrders(grave);
  }

  void lookAtOrders(bool grave) {
    const State state = core.state();
    const ValveOrders& orders = core.orders();
    for (int i = 0; i < count(); ++i) {
      const model::Range& limits = given.channels[i].limits;
      const Valve valve = orders.valve[i];
      if (valve == Valve::kVent) {
        ASSERT_EQ(orders.set_point[i], 0);
        was_inside[i] = false;
      } else {
        // On its way from the atmosphere, and once inside always inside.
        const double set_point = orders.set_point[i];
        const bool inside = limits.contains(set_point);
        ASSERT_TRUE(inside || (set_point >= std::min(0.0, limits.lower) &&
                               set_point <= std::max(0.0, limits.upper)))
            << set_point;
        ASSERT_TRUE(inside || !was_inside[i] || resting) << set_point;
        was_inside[i] = inside;
      }
      ASSERT_TRUE(!(state == State::kEnabled) || valve == Valve::kRegulate);
      ASSERT_TRUE(!(state == State::kDisabled || state == State::kVented) || valve == Valve::kVent);
      if (state != State::kFault) continue;
      const FaultAction action = given.channels[i].action;
      ASSERT_TRUE(!(grave || action == FaultAction::kVent) || valve == Valve::kVent);
      ASSERT_TRUE(!(valve == Valve::kRegulate) || action == FaultAction::kHold);
      ASSERT_TRUE(!(valve == Valve::kClose) || action == FaultAction::kClose);
      ASSERT_TRUE(was_held[i] || valve == Valve::kVent) << "what vented is held again";
      was_held[i] = valve != Valve::kVent;
    }
  }

  // Of what ends kEnabled, this alone is no fault.
  void restEnded() {
    ASSERT_TRUE(resting);
    ASSERT_EQ(core.report().cause, Cause::kNone);
    for (int i = 0; i < count(); ++i) {
      ASSERT_LE(std::abs(last[i]), stepOf(i) + 1e-6) << "the ramp is not over";
      ASSERT_LE(now - read_at[i], given.rules.reading_timeout);
      ASSERT_LE(read_at[i] - empty_at[i], given.rules.spike_time);
    }
    ++rests;
  }

  void afterRest() {
    if (resting) return;
    resting = true;
    target_at.reset();
    down_at = kInfinity;
  }

  void afterTarget() {
    resting = false;
    target_at = now;
  }

  void stoppedOrVented() { barred = true; }
  bool guardStands() const { return guard == Guard::kNotNeeded || guard == Guard::kStands; }

  void afterEnable() {
    target_at.reset();
    order_at = now;
    last = core.orders().set_point;
    for (int i = 0; i < count(); ++i) {
      const model::Range& limits = given.channels[i].limits;
      ASSERT_EQ(last[i], 0);
      ASSERT_EQ(core.goal()[i], std::clamp(0.0, limits.lower, limits.upper));
    }
  }

  void afterReading(const Eigen::VectorXd& reading, double supply) {
    for (int i = 0; i < count(); ++i) {
      if (!std::isfinite(reading[i])) continue;
      read_at[i] = now;
      if (std::abs(reading[i]) <= given.rules.vented_below) empty_at[i] = now;
      over[i].look(now, reading[i] > std::max(0.0, given.channels[i].limits.upper) +
                                         given.rules.trip_margin);
      // At once, whatever the state, and with every valve.
      if (over[i].lasted(now) < given.rules.spike_time) continue;
      ASSERT_EQ(core.state(), State::kFault);
      for (const Valve valve : core.orders().valve) ASSERT_EQ(valve, Valve::kVent);
    }
    if (std::isfinite(supply)) {
      supply_low.look(now, given.rules.min_supply && supply < *given.rules.min_supply);
      ASSERT_TRUE(core.state() != State::kEnabled ||
                  supply_low.lasted(now) < given.rules.spike_time);
    }
  }

  void afterTurn() {
    const ValveOrders& orders = core.orders();
    if (core.state() == State::kEnabled) {
      ASSERT_FALSE(stopped);
      ASSERT_TRUE(link_up);
      ASSERT_TRUE(guardStands());
      ASSERT_LE(now - target_at.value_or(now), given.rules.target_timeout);
      for (const double at : read_at) ASSERT_LE(now - at, given.rules.reading_timeout);
      for (int i = 0; i < count(); ++i) {
        ASSERT_LE(std::abs(orders.set_point[i] - last[i]), stepOf(i) + 1e-6);
      }
      if (resting) afterRestingTurn();
      last = orders.set_point;
      order_at = now;
      ++regulated_turns;
    }
    for (int i = 0; core.state() == State::kFault && i < count(); ++i) {
      if (orders.valve[i] == Valve::kVent) continue;
      ++held_turns;
      ASSERT_LT(now - fault_at, given.rules.hold_time);
      ASSERT_EQ(orders.set_point[i], last[i]);  // the last that it regulated at
    }
  }

  // Down by every channel's slew, and not without end.
  void afterRestingTurn() {
    const Eigen::VectorXd& set_point = core.orders().set_point;
    for (int i = 0; i < count(); ++i) {
      ASSERT_LE(std::abs(set_point[i]), std::max(std::abs(last[i]) - stepOf(i), 0.0) + 1e-6);
    }
    if (set_point.isZero(0)) down_at = std::min(down_at, now);
    ASSERT_LE(now - down_at, given.rules.vent_time);
    ++resting_turns;
  }

  const SafetyCore& core;
  const GivenRules& given;
  double now = 0;
  State before = State::kDisabled;
  std::vector<double> read_at, empty_at;
  std::vector<Spell> over;
  Spell supply_low;
  std::vector<bool> was_held, was_inside;
  std::optional<double> target_at;
  Eigen::VectorXd last;
  double order_at = 0, fault_at = 0;
  bool stopped = false, link_up = true;
  bool resting = false;
  double down_at = kInfinity;  // end of its ramp
  bool barred = false;         // stopped, or a vent requested, since it was enabled
  Guard guard = Guard::kNotNeeded;
  std::set<std::pair<State, State>> edges;
  std::set<Cause> causes;
  int regulated_turns = 0, held_turns = 0, barred_turns = 0, passed_turns = 0;
  int resting_turns = 0, rests = 0;
};

// One turn of a loop under disturbances: its clock stops, jumps back or is NaN, the loop stalls,
// and all functions are called at random.
void turn(SafetyCore& core, Plant& plant, Witness& witness, test::Random& random) {
  const int clock = random.integer(0, 499);
  const double dt = clock == 0 ? random.uniform(0, 2.5) : random.uniform(0, 0.03);
  double told = witness.now + dt;
  if (clock == 1) told = witness.now - random.uniform(0, 1e3);
  if (clock == 2) told = std::nan("");
  if (std::isfinite(told) && told > witness.now) witness.now = told;
  plant.step(dt, core.orders());
  if (random.integer(0, 299) == 0) plant.mishap();
  const auto chance = [&](int one_in) { return random.integer(1, one_in) == 1; };

  if (chance(400)) {
    witness.link_up = !witness.link_up;
    core.linked(told, witness.link_up);
    witness.look(false, false);
  } else if (!witness.link_up && chance(20)) {
    witness.link_up = true;
    core.linked(told, true);
    witness.look(false, false);
  }
  if (chance(600)) {
    witness.stopped = true;
    core.emergencyStop(told, true);
    witness.stoppedOrVented();
    witness.look(false, true);
  } else if (witness.stopped && chance(30)) {
    witness.stopped = false;
    core.emergencyStop(told, false);
    witness.look(false, false);
  }
  if (chance(600)) {
    core.vent(told);
    witness.stoppedOrVented();
    witness.look(false, true);
  }
  if (chance(400) || (!witness.guardStands() && chance(20))) {
    witness.guard = static_cast<Guard>(random.integer(0, static_cast<int>(Guard::kEnded)));
    core.guarded(told, witness.guard);
    witness.look(false, !witness.guardStands());
  }
  if (witness.link_up && !chance(25)) {
    const Eigen::VectorXd reading = plant.read();
    const double supply = chance(50) ? std::nan("") : chance(30) ? 0.5e5 : 5e5;
    core.measured(told, reading, supply);
    witness.look(false, false);
    witness.afterReading(reading, supply);
  }
  if (chance(15)) {
    const State was = core.state();
    const bool enabled = core.enable(told).empty();
    ASSERT_TRUE(!enabled || was == State::kDisabled || was == State::kVented);
    ASSERT_FALSE(enabled && (witness.stopped || !witness.link_up || !witness.guardStands()));
    witness.look(enabled, false);
    if (enabled) witness.afterEnable();
  }
  if (chance(100)) {
    ASSERT_EQ(core.rest(told), core.state() == State::kEnabled);
    witness.look(false, false);
    if (core.state() == State::kEnabled) witness.afterRest();
  }
  // Who is done falls silent, as a rule.
  if (chance(witness.resting ? 100 : 5)) {
    Eigen::VectorXd target(witness.count() + (chance(50) ? 1 : 0));
    for (double& pressure : target) {
      pressure = chance(20) ? std::nan("") : random.uniform(-2e5, 7e5);
      if (chance(50)) pressure = kInfinity;
    }
    if (core.target(told, target)) witness.afterTarget();
    witness.look(false, false);
  }
  core.advance(told);
  witness.look(false, false);
  witness.afterTurn();
}

TEST(SafetyProperty, NoSequenceOfEventsBreaksWhatTheCorePromises) {
  std::set<std::pair<State, State>> edges;
  std::set<Cause> causes;
  long regulated = 0, held = 0, barred = 0, passed = 0, resting = 0, rests = 0;
  for (unsigned seed = 1; seed <= kRuns; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    test::Random random(seed);
    const GivenRules given = randomRules(random);
    SafetyCore core(given.channels, given.rules);
    Plant plant(static_cast<int>(given.channels.size()), random);
    Witness witness(core, given);
    for (int k = 0; k < kTurns; ++k) {
      turn(core, plant, witness, random);
      if (testing::Test::HasFatalFailure()) FAIL() << "turn " << k << ": " << core.reason();
    }
    // Left alone, with the pressure let out, it comes to rest: everything vented.
    plant.pressure.setZero();
    std::fill(plant.ill.begin(), plant.ill.end(), Plant::Ill::kNo);
    core.vent(witness.now);
    for (int k = 0; k < 100; ++k) {
      witness.now += 0.01;
      core.measured(witness.now, Eigen::VectorXd::Zero(witness.count()), 5e5);
      core.advance(witness.now);
    }
    ASSERT_TRUE(core.state() == State::kVented || core.state() == State::kDisabled)
        << core.reason();
    edges.insert(witness.edges.begin(), witness.edges.end());
    causes.insert(witness.causes.begin(), witness.causes.end());
    regulated += witness.regulated_turns;
    held += witness.held_turns;
    barred += witness.barred_turns;
    passed += witness.passed_turns;
    resting += witness.resting_turns;
    rests += witness.rests;
  }
  const std::set<std::pair<State, State>> documented = {
      {State::kDisabled, State::kEnabled}, {State::kDisabled, State::kFault},
      {State::kEnabled, State::kDisabled}, {State::kEnabled, State::kFault},
      {State::kFault, State::kVented},     {State::kVented, State::kEnabled},
      {State::kVented, State::kFault}};
  EXPECT_EQ(edges, documented);
  EXPECT_EQ(causes.size(), kSafetyCauseCount - 1u);
  // The runs were about something.
  EXPECT_GT(regulated, 100000);
  EXPECT_GT(held, 10000);
  EXPECT_GT(barred, 1000);
  EXPECT_GT(passed, 1000);
  EXPECT_GT(resting, 10000);
  EXPECT_GT(rests, 100);
}

}  // namespace
}  // namespace helix_arm::control
