// Every state of the loop, and what leads from one to another.
#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "support/loop_bench.hpp"

namespace helix_arm::follow {
namespace {

using test::LoopBench;

class LoopStates : public test::LoopTest {
 protected:
  // From a loop that has just been made.
  void reach(LoopState wanted) {
    switch (wanted) {
      case LoopState::kIdle:
        bench_.run(1);
        break;
      case LoopState::kOpen:
        bench_.loop.aimAt(here_);
        bench_.run(1, false);
        break;
      case LoopState::kClosed:
        close();
        break;
      case LoopState::kCoasting:
        close();
        bench_.run(1, false);
        break;
      case LoopState::kYielding:
        reachYielding();
        break;
      case LoopState::kDiverging:
        reachDiverging();
        break;
      case LoopState::kDoubtful:
        reachDoubtful();
        break;
    }
    ASSERT_EQ(state(), wanted);
  }

 private:
  void reachYielding() {
    bench_.loop.setOnContact(OnContact::kYield);
    close();
    bench_.run(12);  // contacts are found after ten seconds of pictures
    touch();
    bench_.run(1);
  }
  void reachDiverging() {
    close();
    bench_.options.gain = -3.0;  // the model bends the wrong way
    const double end = bench_.time() + 20;
    while (state() == LoopState::kClosed && bench_.time() < end) bench_.step();
    bench_.options.gain = 1.0;
  }
  void reachDoubtful() {
    close();
    bench_.run(17);
    for (double end = bench_.time() + 10; !doubts() && bench_.time() < end;) lie(0.03, 0.1);
    bench_.step();
  }

 protected:
  bool doubts() const { return bench_.loop.drift().doubtful; }
};

class EachState : public LoopStates, public ::testing::WithParamInterface<LoopState> {};
INSTANTIATE_TEST_SUITE_P(States, EachState,
                         ::testing::Values(LoopState::kIdle, LoopState::kOpen, LoopState::kClosed,
                                           LoopState::kCoasting, LoopState::kYielding,
                                           LoopState::kDiverging, LoopState::kDoubtful),
                         [](const auto& state) { return std::string(nameOf(state.param)); });

TEST_P(EachState, IsIdleWithoutTarget) {
  reach(GetParam());
  bench_.loop.release();
  bench_.step();
  EXPECT_EQ(state(), LoopState::kIdle);
  EXPECT_FALSE(bench_.loop.turn().commands);
}

TEST_P(EachState, IsIdleWhereTheArmIsNotEnabledAndWaitsForANewTarget) {
  reach(GetParam());
  bench_.loop.enable(false);
  bench_.step();
  EXPECT_EQ(state(), LoopState::kIdle);
  EXPECT_FALSE(bench_.loop.turn().commands);
  EXPECT_FALSE(bench_.loop.hasTarget()) << "nothing may move when it is enabled again";
  bench_.loop.enable(true);
  bench_.run(0.5);
  EXPECT_EQ(state(), LoopState::kIdle);
}

TEST_P(EachState, IsResetToOpenOrIdleAndClosesAgain) {
  reach(GetParam());
  letGo();
  bench_.options.lie.setZero();
  bench_.loop.reset();
  bench_.step(false);
  EXPECT_EQ(state(), GetParam() == LoopState::kIdle ? LoopState::kIdle : LoopState::kOpen);
  EXPECT_FALSE(bench_.loop.load().contact);
  bench_.loop.aimAt(here_);
  bench_.run(3);
  EXPECT_EQ(state(), LoopState::kClosed);
  EXPECT_LT(bench_.error(), 1e-3);
}

// Two pictures do not close it, nor do three that took longer than half a second.
TEST_F(LoopStates, ThreePicturesWithinHalfASecondCloseIt) {
  bench_.loop.aimAt(here_);
  bench_.run(0.3, false);
  const auto picture = [this](double pause) {
    bench_.run(pause, false);
    return bench_.loop.picture(bench_.time(), bench_.time(), bench_.trueTwists(),
                               bench_.covariance());
  };
  bench_.run(1, false);
  // The last three come within 0.46 s, those before within 0.6 s.
  for (const double pause : {0.2, 0.29, 0.29, 0.15}) {
    ASSERT_TRUE(picture(pause).accepted());
    bench_.step(false);
    EXPECT_EQ(state(), pause == 0.15 ? LoopState::kClosed : LoopState::kOpen) << bench_.time();
  }
}

TEST_F(LoopStates, AYieldEndsByItself) {
  reach(LoopState::kYielding);
  bench_.run(LoopBench::config().yield_timeout - 3);
  EXPECT_EQ(state(), LoopState::kYielding);
  bench_.run(6);
  EXPECT_EQ(state(), LoopState::kClosed);
  EXPECT_FALSE(bench_.loop.load().contact);
  EXPECT_LT(bench_.error(), 1e-3);
}

// The state tells that the camera is dead; what touched the arm last holds it as long as nobody has
// seen it go.
TEST_F(LoopStates, CoastsAndOpensAndIsHeldWhereAContactIsNoLongerSeen) {
  reach(LoopState::kYielding);
  bench_.loop.follow(control::TipPath({{0.0, here_, {}, {}}, {30.0, there_, {}, {}}}));
  bench_.run(0.5);
  ASSERT_EQ(state(), LoopState::kYielding);
  const auto path_time = bench_.loop.turn().path_time;
  const Eigen::VectorXd held = bench_.loop.turn().pressure;
  const double begin = bench_.time();
  letGo();
  const auto wait = [&](LoopState while_in) {
    while (state() == while_in && bench_.time() < begin + 12) bench_.step(false);
    return bench_.time() - begin - bench_.options.latency;
  };
  EXPECT_NEAR(wait(LoopState::kYielding), 0.3, 0.04);
  EXPECT_EQ(state(), LoopState::kCoasting);
  EXPECT_TRUE(bench_.loop.sees());
  EXPECT_NEAR(wait(LoopState::kCoasting), 3.0, 0.04);
  EXPECT_EQ(state(), LoopState::kOpen);
  EXPECT_FALSE(bench_.loop.sees()) << "what is told of the load is old";
  bench_.run(12, false);
  EXPECT_EQ(state(), LoopState::kOpen);
  EXPECT_TRUE(bench_.loop.turn().held);
  EXPECT_EQ(bench_.loop.turn().path_time, path_time);
  EXPECT_LE((bench_.loop.turn().pressure - held).norm(), 1.0);
  bench_.run(4);
  EXPECT_EQ(state(), LoopState::kClosed);
  EXPECT_FALSE(bench_.loop.turn().held);
  EXPECT_TRUE(bench_.loop.sees());
  EXPECT_GT(bench_.loop.turn().path_time, path_time);
}

// Whatever held the arm then: what is told of the vented arm begins anew.
TEST_F(LoopStates, AVentEndsTheContactThatWasTold) {
  reach(LoopState::kYielding);
  ASSERT_TRUE(bench_.loop.load().contact);
  bench_.loop.enable(false);
  EXPECT_FALSE(bench_.loop.load().contact);
  EXPECT_EQ(bench_.loop.load().score, 0);
  EXPECT_TRUE(bench_.loop.load().tip_beyond_fit.isZero(0));
  bench_.run(12);
  EXPECT_FALSE(bench_.loop.load().contact) << "the load that stays is no new one";
  letGo();
  bench_.loop.reset();
  bench_.loop.enable(true);
  close();
  bench_.run(12);
  ASSERT_FALSE(bench_.loop.load().contact);
  touch();
  bench_.run(1);
  EXPECT_EQ(state(), LoopState::kYielding) << "the next one is found";
}

TEST_F(LoopStates, StandsStillAfterAPathThatAContactStoppedAndGoesOnThere) {
  bench_.loop.setOnContact(OnContact::kStop);
  close();
  bench_.run(12);
  bench_.loop.follow(control::TipPath({{0.0, here_, {}, {}}, {30.0, there_, {}, {}}}));
  bench_.run(2);
  touch();
  bench_.run(1);
  EXPECT_EQ(state(), LoopState::kYielding);
  EXPECT_FALSE(bench_.loop.turn().path_time);
  EXPECT_TRUE(bench_.loop.turn().commands) << "the command is held";
  const Eigen::Vector3d held = bench_.loop.turn().wanted.translation;
  letGo();
  bench_.run(4);
  EXPECT_EQ(state(), LoopState::kClosed);
  EXPECT_EQ(bench_.loop.turn().wanted.translation, held);
  EXPECT_FALSE(bench_.loop.turn().path_time);
}

TEST_F(LoopStates, DivergingNothingIsCorrectedUntilAResetOrANewTarget) {
  reach(LoopState::kDiverging);
  const Eigen::VectorXd frozen = bench_.loop.turn().pressure;
  bench_.options.gain = -3.0;
  bench_.run(3);
  EXPECT_EQ(state(), LoopState::kDiverging);
  EXPECT_LE((bench_.loop.turn().pressure - frozen).norm(), 1.0);
  bench_.options.gain = 1.0;
  bench_.loop.close(false);
  bench_.loop.close(true);
  bench_.step();
  EXPECT_EQ(state(), LoopState::kDiverging);
  bench_.loop.aimAt(there_);
  bench_.step();
  EXPECT_EQ(state(), LoopState::kClosed);
}

// As with two hoses that are swapped. Its corrected model soon says that the target is out of
// reach.
TEST_F(LoopStates, AnArmThatBendsTheWrongWayFromTheStartDiverges) {
  bench_.options.gain = -1.5;
  bench_.loop.aimAt(here_);
  bool diverged = false;
  for (int k = 0; k < 500 && !diverged; ++k) {
    bench_.step();
    diverged = state() == LoopState::kDiverging;
  }
  EXPECT_TRUE(diverged) << nameOf(state()) << ", " << bench_.error() << " m";
}

// An error that comes at once, as from a load, is corrected; the one of a wrong model grows on.
TEST_F(LoopStates, APushDoesNotDiverge) {
  for (const double unseen : {0.0, 2.0}) {
    close();
    if (unseen > 0) bench_.run(unseen, false);
    bench_.options.push << 0, 0, 0, 0, 0.3, -0.2;
    bench_.step();
    ASSERT_GT(bench_.error(), 0.03);
    for (int k = 0; k < 300; ++k) {
      bench_.step();
      ASSERT_NE(state(), LoopState::kDiverging) << k << " after " << unseen << " s without sight";
    }
    EXPECT_LT(bench_.error(), 1e-3);
    letGo();
    bench_.run(3);
  }
}

// Pictures that bend by 0.3 rad in ten seconds, at a target that stands still: no muscle does that.
TEST_F(LoopStates, PicturesThatDriftAreDoubtedAndFollowedNoFarther) {
  for (const OnContact reaction : {OnContact::kReport, OnContact::kYield}) {
    LoopBench bench(model_, truthOf(model_.arm()), LoopBench::config(), {});
    bench.loop.setOnContact(reaction);
    bench.loop.aimAt(here_);
    bench.run(20);
    ASSERT_EQ(bench.loop.state(), LoopState::kClosed);
    double error_then = INFINITY, most = 0;
    for (int k = 1; k <= 3000; ++k) {
      bench.options.lie[5] = 0.3 * std::min(1.0, k / 1000.0);
      bench.step();
      most = std::max(most, bench.error());
      if (!std::isfinite(error_then) && bench.loop.drift().doubtful) error_then = bench.error();
    }
    EXPECT_LT(error_then, 0.012);
    EXPECT_LT(most, 0.014) << "it is not carried on";
    EXPECT_TRUE(bench.loop.drift().doubtful);
    EXPECT_NE(bench.loop.state(), LoopState::kClosed);
    ASSERT_TRUE(bench.loop.budget());
    EXPECT_EQ(bench.loop.budget()->state, estimation::BudgetState::kOutside);
    bench.options.lie.setZero();
    bench.loop.reset();
    bench.run(4);
    EXPECT_EQ(bench.loop.state(), LoopState::kClosed);
    EXPECT_LT(bench.error(), 1e-3);
  }
}

// A view that stands still while the arm moves, but not in every pixel, as through a recorder that
// writes its time into the pictures: something seems to hold the arm, and it is pushed no farther.
TEST_F(LoopStates, AViewThatStandsStillWhileTheArmMovesIsNotFollowed) {
  bench_.loop.setOnContact(OnContact::kYield);
  close();
  bench_.run(17);
  bench_.options.frozen = bench_.trueTwists();
  bench_.run(3);
  ASSERT_EQ(state(), LoopState::kClosed) << "an arm at rest looks the same";
  bench_.loop.aimAt(there_);
  for (const double end = bench_.time() + 3; state() == LoopState::kClosed;) {
    bench_.step();
    ASSERT_LT(bench_.time(), end);
  }
  bench_.run(1);
  const Eigen::VectorXd held = bench_.loop.turn().pressure;
  for (int k = 0; k < 500; ++k) {
    bench_.step();
    ASSERT_NE(state(), LoopState::kClosed) << k;
    ASSERT_LE((bench_.loop.turn().pressure - held).norm(), 100.0) << k;
  }
}

// What is allowed grows with time as the arm creeps, but not while it is exceeded.
TEST_F(LoopStates, ADoubtDoesNotEndByWaiting) {
  reach(LoopState::kDoubtful);
  const double error = bench_.error();
  for (int k = 0; k < 18000; ++k) {
    bench_.step();
    ASSERT_TRUE(doubts()) << "after " << k * LoopBench::kStep << " s";
  }
  EXPECT_LT(bench_.error(), error + 2e-3);
}

TEST_F(LoopStates, PicturesThatAgreeAgainAreFollowedAgain) {
  reach(LoopState::kDoubtful);
  bench_.options.lie.setZero();
  bench_.run(3);
  EXPECT_EQ(state(), LoopState::kClosed);
  EXPECT_LT(bench_.error(), 1e-3);
}

struct WrongClock {
  const char* name;
  double shift;  // of the stamps [s]
  estimation::ObservationFault fault;
};
class EachWrongClock : public LoopStates, public ::testing::WithParamInterface<WrongClock> {};
INSTANTIATE_TEST_SUITE_P(
    Clocks, EachWrongClock,
    ::testing::Values(WrongClock{"ASecondAhead", 1.0, estimation::ObservationFault::kFuture},
                      WrongClock{"ASecondBehind", -1.0, estimation::ObservationFault::kTooOld}),
    [](const auto& clock) { return std::string(clock.param.name); });

TEST_P(EachWrongClock, NeverClosesTheLoop) {
  bench_.options.stamp_shift = GetParam().shift;
  bench_.loop.aimAt(here_);
  for (int k = 0; k < 500; ++k) {
    bench_.step();
    ASSERT_EQ(state(), LoopState::kOpen);
  }
  EXPECT_GT(bench_.faults[GetParam().fault], 150);
  EXPECT_EQ(bench_.faults.size(), 1U) << "each picture is refused for that";
}

// A sudden force is a load that is carried, and what grows after it is none.
TEST_F(LoopStates, AForceAtOnceIsNotDoubtedAndOneThatGrowsSlowlyIs) {
  bench_.loop.setOnContact(OnContact::kReport);
  close();
  bench_.run(12);
  touch();
  for (int k = 0; k < 2000; ++k) {
    bench_.step();
    ASSERT_EQ(state(), LoopState::kClosed) << k;
  }
  EXPECT_LT(bench_.error(), 1e-3);
  letGo();
  for (int k = 0; k < 2000; ++k) {
    bench_.step();
    ASSERT_EQ(state(), LoopState::kClosed) << k;
  }
  for (int k = 0; k < 2000 && !doubts(); ++k) {
    bench_.options.push[4] += 2e-4;
    bench_.step();
  }
  EXPECT_TRUE(doubts());
}

}  // namespace
}  // namespace helix_arm::follow
