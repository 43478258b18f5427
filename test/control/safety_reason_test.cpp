#include <set>
#include <string>

#include <gtest/gtest.h>

#include "support/safety_bench.hpp"

namespace helix_arm::control {
namespace {

using test::Bench;
using test::enabledBench;
using State = SafetyState;

std::string faultOf(const std::function<void(Bench&)>& what, Bench bench = enabledBench()) {
  what(bench);
  EXPECT_TRUE(bench.reach(State::kFault));
  return bench.core.reason();
}

// Culprit, value, rule, what the channels do and what is to be done, of every cause.
TEST(SafetyReason, EveryFaultNamesItsCulpritValueRuleAndRemedy) {
  EXPECT_EQ(faultOf([](Bench& b) { b.core.vent(b.now); }),
            "fault: a vent was requested: all channels vent; call enable to continue");
  EXPECT_EQ(faultOf([](Bench& b) { b.core.emergencyStop(b.now, true); }),
            "fault: the emergency stop was engaged: all channels vent; make the arm safe, release "
            "the stop, then call enable");
  EXPECT_EQ(faultOf([](Bench& b) { b.commands = false; }),
            "fault: no target came for 1.02 s, longer than 1 s (safety.target_timeout_s): holds "
            "holds, closes is closed for 8 s (safety.hold_time_s), the others vent; check that the "
            "commander runs and that the network is up, then call enable");
  EXPECT_EQ(faultOf([](Bench& b) { b.readsAs(2, std::nan("")); }),
            "fault: closes was not read for 0.52 s, longer than 0.5 s (safety.reading_timeout_s): "
            "holds holds for 8 s (safety.hold_time_s), the others vent; check the regulator's "
            "power, cable and address, then call enable");
  EXPECT_EQ(
      faultOf([](Bench& b) { b.core.linked(b.now, false); },
              enabledBench(1e5, {{"muscle_1", {0, 4e5}, 1e6, FaultAction::kHold}})),
      "fault: the regulator's link went down, or orders did not reach it in time: all channels "
      "will vent as soon as the regulator can be reached; until then shut the supply and open the "
      "relief valve by hand; check the regulator's power and cable, then call enable");
  EXPECT_EQ(faultOf([](Bench& b) { b.core.guarded(b.now, Guard::kEnded); }),
            "fault: the guard, which vents the arm if this process is killed, has ended or does "
            "not respond: all channels vent; find out what ended or stopped it (a kill, too little "
            "memory), then call enable");
  EXPECT_EQ(faultOf([](Bench& b) { b.readsAs(1, 4.621e5); }),
            "fault: holds reads 462.1 kPa, more than 430 kPa (its limit and "
            "safety.trip_margin_kpa) for 0.125 s: all channels vent; check for a valve that sticks "
            "or a sensor that drifts, then call enable");
  EXPECT_EQ(faultOf([](Bench& b) { b.readsAs(0, -9e4); },
                    enabledBench(1e5, {{"vacuum", {-5e4, 0}, 1e6, FaultAction::kVent}})),
            "fault: vacuum reads -90.0 kPa, less than -80 kPa (its limit and "
            "safety.trip_margin_kpa) for 0.125 s: all channels vent; check for a valve that sticks "
            "or a sensor that drifts, then call enable");
  EXPECT_EQ(faultOf([](Bench& b) { b.supply = 3e5; },
                    enabledBench(1e5, {{"muscle_1", {0, 4e5}, 1e6, FaultAction::kVent}})),
            "fault: the supply reads 300.0 kPa, less than 350 kPa (safety.min_supply_kpa) for "
            "0.125 s: all channels vent; check compressor, tank and main valve, then call enable");
  EXPECT_EQ(faultOf([](Bench& b) { b.readsAs(0, 1.85e5); },
                    enabledBench(1e5, {{"muscle_1", {0, 4e5}, 1e6, FaultAction::kHold}})),
            "fault: muscle_1 is 85.0 kPa from the pressure expected of its set point, more than 40 "
            "kPa (safety.follow.tolerance_kpa) for 1 s: all channels vent; check for a valve that "
            "sticks, a kinked or loose tube and a supply that is too weak, then call enable");
  EXPECT_EQ(faultOf([](Bench& b) { b.readsAs(1, 6e4); }),
            "fault: holds fell 40.0 kPa below its constant set point, more than 25 kPa "
            "(safety.leak_drop_kpa) for 0.125 s: all channels vent; check for a burst muscle or a "
            "loose tube, repair it, then call enable");
  EXPECT_EQ(faultOf([](Bench& b) {
              b.core.vent(b.now);
              ASSERT_TRUE(b.reach(State::kVented));
              b.readsAs(1, 1.5e4);
            }),
            "fault: holds reads 15.0 kPa although it should be empty, more than 10 kPa from the "
            "atmosphere (safety.vented_below_kpa): all channels vent; shut the supply and check "
            "for a valve that does not close, then call enable");
}

// As a loop at its usual rate notices it.
TEST(SafetyReason, ATimeOutThatIsNoticedAtOnceHasOneNumber) {
  Bench bench = enabledBench();
  bench.commands = false;
  for (int k = 0; k < 400 && bench.state() == State::kEnabled; ++k) bench.turn(0.005);
  ASSERT_EQ(bench.state(), State::kFault);
  EXPECT_EQ(bench.core.reason().find("fault: no target came for 1 s (safety.target_timeout_s): "),
            0U)
      << bench.core.reason();
}

TEST(SafetyReason, TheOtherStatesSayWhatPreventsEnabling) {
  Bench bench;
  EXPECT_EQ(bench.core.refusal(bench.now),
            "vents has not been read yet; wait for its first reading, or check the regulator's "
            "power, cable and address");
  bench.turn();
  EXPECT_EQ(bench.core.reason(), "disabled: all channels vent; call enable");
  ASSERT_EQ(bench.core.enable(bench.now), "");
  EXPECT_EQ(bench.core.reason(), "enabled: follows targets");
  EXPECT_EQ(bench.core.refusal(bench.now), "it is already enabled; send targets");
  bench.commands = false;
  ASSERT_TRUE(bench.core.rest(bench.now));
  EXPECT_EQ(bench.core.reason(), "enabled: ramps down to rest");
  ASSERT_TRUE(bench.reach(State::kDisabled));
  EXPECT_EQ(bench.core.reason(), "disabled: at rest: all channels vent; call enable");
  ASSERT_EQ(bench.core.enable(bench.now), "");
  bench.core.vent(bench.now);
  EXPECT_EQ(bench.core.refusal(bench.now), bench.core.reason());
  ASSERT_TRUE(bench.reach(State::kVented));
  EXPECT_EQ(bench.core.reason(),
            "vented: no pressure remains after a vent was requested; call enable to continue");
  bench.core.emergencyStop(bench.now, true);
  ASSERT_TRUE(bench.reach(State::kVented));
  EXPECT_EQ(bench.core.refusal(bench.now),
            "the emergency stop is engaged; make the arm safe and release it");
}

TEST(SafetyReason, ARefusalNamesWhatIsWrongNow) {
  Bench bench;
  bench.turn();
  bench.core.guarded(bench.now, Guard::kStarting);
  EXPECT_EQ(bench.core.refusal(bench.now),
            "the guard, which vents the arm if this process is killed, has not answered yet; call "
            "enable again in a moment");
  for (const Guard guard : {Guard::kStandsStill, Guard::kEnded}) {
    bench.core.guarded(bench.now, guard);
    EXPECT_EQ(bench.core.refusal(bench.now),
              std::string("the guard, which vents the arm if this process is killed, ") +
                  (guard == Guard::kEnded ? "has ended" : "does not respond") +
                  "; see what it and this process have printed (a kill, a scene file that is "
                  "missing or cannot be read, too little memory), then call enable");
  }
  bench.core.guarded(bench.now, Guard::kStands);
  bench.core.linked(bench.now, false);
  EXPECT_EQ(bench.core.refusal(bench.now),
            "the regulator's link is down; check its power and cable");
  bench.core.linked(bench.now, true);
  EXPECT_EQ(bench.core.refusal(bench.now + 0.75),
            "vents was not read for 0.75 s, longer than 0.5 s (safety.reading_timeout_s); check "
            "the regulator's power, cable and address");
  EXPECT_EQ(bench.core.refusal(bench.now - 1e6), "");
  EXPECT_EQ(bench.core.refusal(std::nan("")), "");
  bench.readsAs(2, 1.42e4);
  bench.run(1);
  EXPECT_EQ(
      bench.core.refusal(bench.now),
      "closes reads 14.2 kPa, more than 10 kPa from the atmosphere (safety.vented_below_kpa); wait "
      "for it to vent, or check for a valve that does not close");
  bench.spoil = nullptr;
  bench.supply = 3e5;
  bench.turn();
  EXPECT_EQ(bench.core.refusal(bench.now),
            "the supply reads 300.0 kPa, less than 350 kPa (safety.min_supply_kpa); check "
            "compressor, tank and main valve");
  bench.supply = std::nan("");
  bench.run(0.75);
  EXPECT_EQ(
      bench.core.refusal(bench.now),
      "the supply was not read for 0.75 s, longer than 0.5 s (safety.reading_timeout_s); check the "
      "regulator, or leave out safety.min_supply_kpa if it does not measure its supply");
}

TEST(SafetyReason, AnOverdueVentIsReportedWithTheRemainingPressure) {
  Bench bench = enabledBench();
  bench.readsAs(1, 5e4);
  bench.core.vent(bench.now);
  bench.run(3 + 2 * test::kTurn);
  EXPECT_EQ(bench.core.reason(),
            "fault: a vent was requested: all channels vent; holds still reads 50.0 kPa, 3.0 s "
            "after it began to vent (safety.vent_time_s is 3): shut the supply and open the relief "
            "valve by hand; call enable to continue");
}

TEST(SafetyReason, EveryNameIsOneOfItsOwn) {
  std::set<std::string> names;
  for (int i = 0; i < 4; ++i) names.insert(nameOf(static_cast<SafetyState>(i)));
  EXPECT_EQ(names.size(), 4u);
  names.clear();
  for (int i = 0; i < kSafetyCauseCount; ++i) names.insert(nameOf(static_cast<SafetyCause>(i)));
  EXPECT_EQ(names.size(), static_cast<std::size_t>(kSafetyCauseCount));
  EXPECT_STREQ(nameOf(SafetyCause::kVentRequested), "vent_requested");
  EXPECT_STREQ(nameOf(SafetyCause::kStaleTarget), "stale_target");
  EXPECT_STREQ(nameOf(SafetyCause::kGuardLost), "guard_lost");
  EXPECT_STREQ(nameOf(FaultAction::kClose), "close");
}

}  // namespace
}  // namespace helix_arm::control
