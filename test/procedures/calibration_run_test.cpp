#include "helix_arm/procedures/calibration_run.hpp"

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "support/has.hpp"

namespace helix_arm::procedures {
namespace {

constexpr double kTick = 0.02;
const Eigen::Vector2d kRest(0, 0);
const RunRules kRules{3, 1e5, 5.0};

Eigen::MatrixXd twoSteps() {
  Eigen::MatrixXd plan(2, 2);
  plan << 1e5, 0, 0, 2e5;
  return plan;
}

// An arm that is at once where it is commanded to, and still so long after.
class Arm {
 public:
  explicit Arm(double settling_time = 0.5) : settling_time_(settling_time) {}

  Settling operator()(double now, const Eigen::VectorXd& pressure) {
    if (pressure_.size() == 0 || pressure_ != pressure) since_ = now;
    pressure_ = pressure;
    Settling out;
    out.set_point = pressure;
    out.state = now - since_ >= settling_time_ ? SettleState::kSettled : SettleState::kMoving;
    out.reason = out.settled() ? "" : "it sways";
    if (out.settled()) out.last = Sample{std::floor(10 * now) / 10, pressure, {}};  // 10 Hz
    return out;
  }

 private:
  double settling_time_;
  double since_ = 0;
  Eigen::VectorXd pressure_;
};

// A run, and what it has commanded, with any arm.
class Play {
 public:
  CalibrationRun run;
  double now = 100;
  std::vector<Eigen::VectorXd> commands{kRest};
  std::vector<Sample> captures;
  int steps_done = 0;

  explicit Play(const RunRules& rules = kRules) : run(twoSteps(), kRest, kRest, rules) {}

  const Eigen::VectorXd& command() const { return commands.back(); }

  // One tick in which the arm has this state.
  void tick(const Settling& state) {
    now += kTick;
    const auto order = run.advance(now, state);
    commands.push_back(order.pressure);
    if (order.capture) captures.push_back(*order.capture);
    steps_done += order.step_done;
  }

  // To the end, or for so many ticks. @param arm  its state, by time and command.
  template <class AnyArm>
  void with(AnyArm&& arm, int most_ticks = 100000) {
    for (int k = 0; k < most_ticks && !run.ended(); ++k) tick(arm(now + kTick, command()));
  }

  // It has ended at rest, without a jump.
  void expectEnd(RunEnd verdict, const std::string& reason) const {
    EXPECT_TRUE(run.ended());
    EXPECT_EQ(run.verdict(), verdict);
    EXPECT_TRUE(reason.empty() ? run.reason().empty() : test::has(run.reason(), reason));
    EXPECT_EQ(command(), kRest);
    for (std::size_t k = 1; k < commands.size(); ++k) {
      EXPECT_LE((commands[k] - commands[k - 1]).cwiseAbs().maxCoeff(),
                kRules.ramp * kTick * (1 + 1e-6));
    }
  }
};

// What is said of an arm that is at this set point.
Settling stateOf(SettleState state, const Eigen::VectorXd& set_point,
                 const std::string& reason = "") {
  Settling out;
  out.state = state;
  out.set_point = set_point;
  out.reason = reason;
  return out;
}

TEST(CalibrationRun, CapturesAtEveryStepAndEndsAtRest) {
  Play play;
  play.with(Arm());
  play.expectEnd(RunEnd::kCompleted, "");
  EXPECT_EQ(play.steps_done, 2);
  ASSERT_EQ(play.captures.size(), 6u);
  for (int k = 0; k < 6; ++k) {
    EXPECT_EQ(play.captures[k].pressure, twoSteps().row(k / 3).transpose());
    if (k > 0) {
      EXPECT_GT(play.captures[k].time, play.captures[k - 1].time) << "same picture";
    }
  }
}

TEST(CalibrationRun, DoesNotCaptureBeforeTheCommandIsInForce) {
  Play play;
  // Someone says it is settled, but at the old set point.
  play.with([](double now, const Eigen::VectorXd&) {
    Settling out = stateOf(SettleState::kSettled, kRest);
    out.last = Sample{now, kRest, {}};
    return out;
  });
  EXPECT_TRUE(play.captures.empty());
  play.expectEnd(RunEnd::kAborted, "does not follow");
}

TEST(CalibrationRun, AStepThatDoesNotSettleAbortsWithItsReasonAndRampsDown) {
  Play play;
  play.with(Arm(1e9));
  play.expectEnd(RunEnd::kAborted, "step 1 has not settled within 5 s: it sways");
  // 1 s up, 5 s of patience, 1 s down.
  EXPECT_NEAR(kTick * static_cast<double>(play.commands.size()), 7.0, 0.2);
}

// An arm whose camera is out from tick to tick, each included, counted from 0.
class SeenArm {
 public:
  SeenArm(int from, int to) : from_(from), to_(to) {}

  Settling operator()(double now, const Eigen::VectorXd& pressure) {
    Settling out = arm_(now, pressure);
    if (tick_ >= from_ && tick_ <= to_) {
      out = stateOf(SettleState::kUnseen, pressure, "tag detections: none received for 2.00 s");
    }
    ++tick_;
    return out;
  }

 private:
  Arm arm_;
  int from_, to_, tick_ = 0;
};

constexpr int kPatienceTicks = 250;  // 5 s
constexpr int kRampTicks = 50;       // 1 s for the first step

TEST(CalibrationRun, ItWaitsForACameraThatIsOutWhereverItIs) {
  for (const int begin : {0, kRampTicks / 2, kRampTicks + 5, kRampTicks + 40}) {
    Play play;
    play.with(SeenArm(begin, begin + 150));
    play.expectEnd(RunEnd::kCompleted, "");
    EXPECT_EQ(play.captures.size(), 6u);
    EXPECT_EQ(play.steps_done, 2);
  }
}

TEST(CalibrationRun, WhileNothingIsSeenThePressuresStandStill) {
  Play play;
  const int begin = kRampTicks / 2;
  play.with(SeenArm(begin, begin + 100), begin + 101);
  EXPECT_EQ(play.run.phase(), RunPhase::kRamping);
  EXPECT_TRUE(play.run.waitsForPictures());
  EXPECT_GT(play.commands[begin].maxCoeff(), 0);
  for (std::size_t k = begin; k < play.commands.size(); ++k) {
    EXPECT_EQ(play.commands[k], play.commands[begin]);
  }
}

TEST(CalibrationRun, ACameraThatStaysOutEndsItAfterItsPatience) {
  for (const auto& [begin, words] : {std::pair{kRampTicks / 2, "has waited for pictures for 5 s"},
                                     {kRampTicks + 5, "has not settled within 5 s"}}) {
    Play play;
    SeenArm arm(begin, 1 << 20);
    play.with(arm, begin + kPatienceTicks - 10);
    EXPECT_TRUE(play.run.phase() == RunPhase::kRamping || play.run.phase() == RunPhase::kSettling);
    const std::size_t before = play.commands.size();
    play.with(arm);
    play.expectEnd(RunEnd::kAborted, std::string("step 1 ") + words);
    EXPECT_TRUE(test::has(play.run.reason(), "tag detections: none received"));
    // 10 ticks of patience, and the ramp down of at most 1 s.
    EXPECT_LT(play.commands.size() - before, 100u);
  }
}

TEST(CalibrationRun, ItsReturnDoesNotWaitForPicturesButForTheCommand) {
  Play play;
  play.run.end(RunEnd::kPreempted, "cancelled");
  for (int k = 0; k < 20; ++k) {
    play.tick(stateOf(SettleState::kUnseen, Eigen::Vector2d(5e4, 0)));
  }
  EXPECT_FALSE(play.run.ended()) << "the command has not followed";
  play.tick(stateOf(SettleState::kUnseen, kRest));
  EXPECT_TRUE(play.run.ended());
}

TEST(CalibrationRun, StalePressuresAbortAtOnceAndRampDown) {
  Play play;
  play.with(Arm(), 60);
  ASSERT_EQ(play.run.phase(), RunPhase::kSettling);
  Settling stale;
  stale.reason = "measured pressures: none received for 2.00 s";
  play.with([&](double, const Eigen::VectorXd&) { return stale; });
  play.expectEnd(RunEnd::kAborted, stale.reason);
}

TEST(CalibrationRun, PreemptedItRampsDownFromWhereverItIs) {
  for (const int ticks : {10, 60, 140}) {
    Play play;
    Arm arm;
    play.with(arm, ticks);
    const std::size_t captured = play.captures.size();
    play.run.end(RunEnd::kPreempted, "asked to");
    play.run.end(RunEnd::kAborted, "later");
    play.with(arm);
    play.expectEnd(RunEnd::kPreempted, "asked to");
    EXPECT_EQ(play.captures.size(), captured);
  }
}

TEST(CalibrationRun, LeavesTheArmToAnotherCommander) {
  Play play;
  play.with(Arm(), 60);
  play.run.yield("the series commands the arm");
  EXPECT_TRUE(play.run.ended());
  EXPECT_EQ(play.run.verdict(), RunEnd::kAborted);
  EXPECT_EQ(play.run.reason(), "the series commands the arm");
}

TEST(CalibrationRun, ItsRampsGoOnWhereTheyWereAfterAPause) {
  Play play;
  Arm arm;
  play.with(arm, 1);
  EXPECT_EQ(play.command(), kRest);
  play.now += 2000;
  play.with(arm, 1);
  EXPECT_GT(play.command().maxCoeff(), 0);
  EXPECT_LE(play.command().maxCoeff(), 1.01e4) << "a tenth of a second's worth";
}

TEST(CalibrationRun, WhereTimeGoesBackItEndsAndRampsDown) {
  for (const int ticks : {5, 80}) {  // ramping, settling
    Play play({3, 1e5, 1e4});
    const auto restless = [](double, const Eigen::VectorXd& pressure) {
      return stateOf(SettleState::kMoving, pressure);
    };
    play.with(restless, ticks);
    EXPECT_GT(play.command().maxCoeff(), 0);
    play.now = 3;
    play.with(restless, 1000);
    play.expectEnd(RunEnd::kAborted, "time went back");
  }
}

// Until the last step is done.
void playToReturn(Play& play, Arm& arm) {
  while (play.run.phase() != RunPhase::kReturning) {
    ASSERT_LT(play.now, 200);
    play.with(arm, 1);
  }
}

TEST(CalibrationRun, CancelledDuringItsReturnItIsNotComplete) {
  Play play;
  Arm arm;
  playToReturn(play, arm);
  EXPECT_EQ(play.run.verdict(), RunEnd::kCompleted);
  play.run.end(RunEnd::kPreempted, "cancelled");
  play.run.end(RunEnd::kAborted, "too late");
  EXPECT_EQ(play.run.verdict(), RunEnd::kPreempted);
  EXPECT_EQ(play.run.reason(), "cancelled");
  EXPECT_EQ(play.run.phase(), RunPhase::kReturning);
}

// The next run begins where the command is, so it must not be above the rest any more.
TEST(CalibrationRun, ItEndsOnceTheCommandHasFollowedItToRest) {
  Play play;
  Arm arm;
  playToReturn(play, arm);
  const Eigen::VectorXd late = kRest + Eigen::Vector2d(5e4, 0);
  const auto stays_late = [&](double now, const Eigen::VectorXd&) { return arm(now, late); };
  while (play.command() != kRest) {
    ASSERT_LT(play.now, 300);
    play.with(stays_late, 1);
  }
  play.with(stays_late, 20);
  EXPECT_FALSE(play.run.ended());
  play.with(arm, 1);
  EXPECT_TRUE(play.run.ended());

  // A command that never follows holds it up for its patience only.
  Play stuck;
  stuck.run.end(RunEnd::kPreempted, "cancelled");
  stuck.with(stays_late, kPatienceTicks);
  EXPECT_FALSE(stuck.run.ended());
  stuck.with(stays_late, 5);
  EXPECT_TRUE(stuck.run.ended());
}

}  // namespace
}  // namespace helix_arm::procedures
