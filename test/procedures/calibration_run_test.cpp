#include "helix_arm/procedures/calibration_run.hpp"

#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
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

struct Record {
  std::vector<Eigen::VectorXd> commands;
  std::vector<Sample> captures;
  int steps_done = 0;
};

// Runs to the end, or for so many ticks.
Record play(CalibrationRun& run, Eigen::VectorXd command,
            const std::function<Settling(double, const Eigen::VectorXd&)>& arm,
            int most_ticks = 100000) {
  Record out;
  static double now = 100;
  for (int k = 0; k < most_ticks && !run.ended(); ++k) {
    now += kTick;
    const auto order = run.advance(now, arm(now, command));
    command = order.pressure;
    out.commands.push_back(command);
    if (order.capture) out.captures.push_back(*order.capture);
    out.steps_done += order.step_done;
  }
  return out;
}

Record play(CalibrationRun& run, Arm arm = Arm()) { return play(run, kRest, arm); }

void expectBoundedRamps(const Record& record, const Eigen::VectorXd& from) {
  Eigen::VectorXd last = from;
  for (const Eigen::VectorXd& command : record.commands) {
    EXPECT_LE((command - last).cwiseAbs().maxCoeff(), kRules.ramp * kTick * (1 + 1e-6));
    last = command;
  }
}

TEST(CalibrationRun, CapturesAtEveryStepAndEndsAtRest) {
  CalibrationRun run(twoSteps(), kRest, kRest, kRules);
  const Record record = play(run);
  ASSERT_TRUE(run.ended());
  EXPECT_EQ(run.verdict(), RunEnd::kCompleted);
  EXPECT_TRUE(run.reason().empty());
  EXPECT_EQ(record.steps_done, 2);
  ASSERT_EQ(record.captures.size(), 6u);
  for (int k = 0; k < 6; ++k) {
    EXPECT_EQ(record.captures[k].pressure, twoSteps().row(k / 3).transpose());
    if (k > 0) {
      EXPECT_GT(record.captures[k].time, record.captures[k - 1].time) << "same picture";
    }
  }
  EXPECT_EQ(record.commands.back(), kRest);
  expectBoundedRamps(record, kRest);
}

TEST(CalibrationRun, DoesNotCaptureBeforeTheCommandIsInForce) {
  CalibrationRun run(twoSteps(), kRest, kRest, kRules);
  // Someone says it is settled, but at the old set point.
  const Record record = play(run, kRest, [](double now, const Eigen::VectorXd&) {
    Settling out;
    out.state = SettleState::kSettled;
    out.set_point = kRest;
    out.last = Sample{now, kRest, {}};
    return out;
  });
  EXPECT_TRUE(record.captures.empty());
  EXPECT_EQ(run.verdict(), RunEnd::kAborted);
  EXPECT_TRUE(test::has(run.reason(), "does not follow"));
}

TEST(CalibrationRun, AStepThatDoesNotSettleAbortsWithItsReasonAndRampsDown) {
  CalibrationRun run(twoSteps(), kRest, kRest, kRules);
  const Record record = play(run, Arm(1e9));
  EXPECT_EQ(run.verdict(), RunEnd::kAborted);
  EXPECT_TRUE(test::has(run.reason(), "step 1 has not settled within 5 s: it sways"));
  EXPECT_EQ(record.commands.back(), kRest);
  expectBoundedRamps(record, kRest);
  // 1 s up, 5 s of patience, 1 s down.
  EXPECT_NEAR(kTick * static_cast<double>(record.commands.size()), 7.0, 0.2);
}

// An arm whose camera is out from tick to tick, each included, counted from 0.
class SeenArm {
 public:
  SeenArm(int from, int to) : from_(from), to_(to) {}

  Settling operator()(double now, const Eigen::VectorXd& pressure) {
    Settling out = arm_(now, pressure);
    if (tick_ >= from_ && tick_ <= to_) {
      out.state = SettleState::kUnseen;
      out.reason = "tag detections: none received for 2.00 s";
      out.last.reset();
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
    CalibrationRun run(twoSteps(), kRest, kRest, kRules);
    const Record record = play(run, kRest, SeenArm(begin, begin + 150));
    EXPECT_EQ(run.verdict(), RunEnd::kCompleted) << run.reason();
    EXPECT_EQ(record.captures.size(), 6u);
    EXPECT_EQ(record.steps_done, 2);
    expectBoundedRamps(record, kRest);
  }
}

TEST(CalibrationRun, WhileNothingIsSeenThePressuresStandStill) {
  CalibrationRun run(twoSteps(), kRest, kRest, kRules);
  const int begin = kRampTicks / 2;
  const Record record = play(run, kRest, SeenArm(begin, begin + 100), begin + 101);
  EXPECT_EQ(run.phase(), RunPhase::kRamping);
  EXPECT_TRUE(run.waitsForPictures());
  const auto& commands = record.commands;
  EXPECT_GT(commands[begin - 1].maxCoeff(), 0);
  for (std::size_t k = begin; k < commands.size(); ++k) EXPECT_EQ(commands[k], commands[begin - 1]);
}

TEST(CalibrationRun, ACameraThatStaysOutEndsItAfterItsPatience) {
  struct Case {
    int begin;
    const char* words;
  };
  for (const Case& one : {Case{kRampTicks / 2, "step 1 has waited for pictures for 5 s"},
                          Case{kRampTicks + 5, "step 1 has not settled within 5 s"}}) {
    CalibrationRun run(twoSteps(), kRest, kRest, kRules);
    SeenArm arm(one.begin, 1 << 20);
    const Record before = play(run, kRest, arm, one.begin + kPatienceTicks - 10);
    EXPECT_TRUE(run.phase() == RunPhase::kRamping || run.phase() == RunPhase::kSettling);
    SeenArm dark(0, 1 << 20);
    const Record after = play(run, before.commands.back(), dark);
    EXPECT_EQ(run.verdict(), RunEnd::kAborted);
    EXPECT_TRUE(test::has(run.reason(), one.words));
    EXPECT_TRUE(test::has(run.reason(), "tag detections: none received"));
    EXPECT_EQ(after.commands.back(), kRest);
    // 10 ticks of patience, and the ramp down of at most 1 s.
    EXPECT_LT(after.commands.size(), 100u);
    expectBoundedRamps(after, before.commands.back());
  }
}

TEST(CalibrationRun, ItsReturnDoesNotWaitForPicturesButForTheCommand) {
  CalibrationRun run(twoSteps(), kRest, kRest, kRules);
  run.end(RunEnd::kPreempted, "cancelled");
  Settling dark;
  dark.state = SettleState::kUnseen;
  dark.set_point = Eigen::Vector2d(5e4, 0);
  for (int k = 0; k < 20; ++k) run.advance(kTick * k, dark);
  EXPECT_FALSE(run.ended()) << "the command has not followed";
  dark.set_point = kRest;
  run.advance(kTick * 20, dark);
  EXPECT_TRUE(run.ended());
}

TEST(CalibrationRun, StalePressuresAbortAtOnceAndRampDown) {
  CalibrationRun run(twoSteps(), kRest, kRest, kRules);
  Arm arm;
  Record before = play(run, kRest, std::ref(arm), 60);
  ASSERT_EQ(run.phase(), RunPhase::kSettling);
  const Record after = play(run, before.commands.back(), [](double, const Eigen::VectorXd&) {
    Settling out;
    out.reason = "measured pressures: none received for 2.00 s";
    return out;
  });
  EXPECT_TRUE(run.ended());
  EXPECT_EQ(run.verdict(), RunEnd::kAborted);
  EXPECT_EQ(run.reason(), "measured pressures: none received for 2.00 s");
  EXPECT_EQ(after.commands.back(), kRest);
  expectBoundedRamps(after, before.commands.back());
}

TEST(CalibrationRun, PreemptedItRampsDownFromWhereverItIs) {
  for (const int ticks : {10, 60, 140}) {
    CalibrationRun run(twoSteps(), kRest, kRest, kRules);
    Arm arm;
    const Record before = play(run, kRest, std::ref(arm), ticks);
    run.end(RunEnd::kPreempted, "asked to");
    run.end(RunEnd::kAborted, "later");
    const Record after = play(run, before.commands.back(), std::ref(arm));
    EXPECT_TRUE(run.ended());
    EXPECT_EQ(run.verdict(), RunEnd::kPreempted);
    EXPECT_EQ(run.reason(), "asked to");
    EXPECT_TRUE(after.captures.empty());
    EXPECT_EQ(after.commands.back(), kRest);
    expectBoundedRamps(after, before.commands.back());
  }
}

TEST(CalibrationRun, LeavesTheArmToAnotherCommander) {
  CalibrationRun run(twoSteps(), kRest, kRest, kRules);
  Arm arm;
  play(run, kRest, arm, 60);
  run.yield("the series commands the arm");
  EXPECT_TRUE(run.ended());
  EXPECT_EQ(run.verdict(), RunEnd::kAborted);
  EXPECT_EQ(run.reason(), "the series commands the arm");
}

TEST(CalibrationRun, ItsRampsGoOnWhereTheyWereAfterAPause) {
  CalibrationRun run(twoSteps(), kRest, kRest, kRules);
  Arm arm;
  Eigen::VectorXd command = kRest;
  command = run.advance(1, arm(1, command)).pressure;
  EXPECT_EQ(command, kRest);
  command = run.advance(2000, arm(2000, command)).pressure;
  EXPECT_GT(command.maxCoeff(), 0);
  EXPECT_LE(command.maxCoeff(), 1.01e4) << "a tenth of a second's worth";
}

TEST(CalibrationRun, WhereTimeGoesBackItEndsAndRampsDown) {
  for (const int ticks : {5, 80}) {  // ramping, settling
    CalibrationRun run(twoSteps(), kRest, kRest, {3, 1e5, 1e4});
    const auto restless = [](double, const Eigen::VectorXd& pressure) {
      Settling out;
      out.state = SettleState::kMoving;
      out.set_point = pressure;
      return out;
    };
    double now = 1000;
    Eigen::VectorXd command = kRest;
    for (int k = 0; k < ticks; ++k) {
      now += 0.02;
      command = run.advance(now, restless(now, command)).pressure;
    }
    EXPECT_GT(command.maxCoeff(), 0);
    now = 3;
    for (int k = 0; k < 1000 && !run.ended(); ++k) {
      command = run.advance(now, restless(now, command)).pressure;
      now += 0.02;
    }
    ASSERT_TRUE(run.ended());
    EXPECT_EQ(command, kRest);
    EXPECT_EQ(run.verdict(), RunEnd::kAborted);
    EXPECT_TRUE(test::has(run.reason(), "time went back"));
  }
}

TEST(CalibrationRun, CancelledDuringItsReturnItIsNotComplete) {
  CalibrationRun run(twoSteps(), kRest, kRest, kRules);
  Arm arm;
  double now = 0;
  Eigen::VectorXd command = kRest;
  while (run.phase() != RunPhase::kReturning) {
    now += 0.02;
    ASSERT_LT(now, 100);
    command = run.advance(now, arm(now, command)).pressure;
  }
  EXPECT_EQ(run.verdict(), RunEnd::kCompleted);
  run.end(RunEnd::kPreempted, "cancelled");
  run.end(RunEnd::kAborted, "too late");
  EXPECT_EQ(run.verdict(), RunEnd::kPreempted);
  EXPECT_EQ(run.reason(), "cancelled");
  EXPECT_EQ(run.phase(), RunPhase::kReturning);
}

// The next run begins where the command is, so it must not be above the rest any more.
TEST(CalibrationRun, ItEndsOnceTheCommandHasFollowedItToRest) {
  CalibrationRun run(twoSteps(), kRest, kRest, kRules);
  Arm arm;
  double now = 0;
  const auto advance = [&](const Eigen::VectorXd& command) {
    now += 0.02;
    return run.advance(now, arm(now, command)).pressure;
  };
  Eigen::VectorXd command = kRest;
  while (run.phase() != RunPhase::kReturning) {
    ASSERT_LT(now, 100);
    command = advance(command);
  }
  const Eigen::VectorXd late = kRest + Eigen::Vector2d(5e4, 0);
  while (command != kRest) {
    ASSERT_LT(now, 200);
    command = advance(late);
  }
  for (int k = 0; k < 20; ++k) {
    advance(late);
    EXPECT_FALSE(run.ended());
  }
  advance(kRest);
  EXPECT_TRUE(run.ended());

  // A command that never follows holds it up for its patience only.
  CalibrationRun stuck(twoSteps(), kRest, kRest, kRules);
  stuck.end(RunEnd::kPreempted, "cancelled");
  for (double after = 0; after < kRules.patience; after += 0.02) {
    now += 0.02;
    stuck.advance(now, arm(now, late));
    EXPECT_FALSE(stuck.ended()) << after;
  }
  for (int k = 0; k < 5; ++k) {
    now += 0.02;
    stuck.advance(now, arm(now, late));
  }
  EXPECT_TRUE(stuck.ended());
}

TEST(CalibrationRun, UnusableArgumentsAreRefused) {
  const double infinity = std::numeric_limits<double>::infinity();
  EXPECT_THROW(CalibrationRun(Eigen::MatrixXd(0, 2), kRest, kRest, kRules), std::invalid_argument);
  EXPECT_THROW(CalibrationRun(twoSteps(), Eigen::Vector3d::Zero(), kRest, kRules),
               std::invalid_argument);
  EXPECT_THROW(CalibrationRun(twoSteps(), kRest, Eigen::Vector3d::Zero(), kRules),
               std::invalid_argument);
  EXPECT_THROW(CalibrationRun(twoSteps(), Eigen::Vector2d(infinity, 0), kRest, kRules),
               std::invalid_argument);
  for (const int captures : {0, 6}) {
    EXPECT_THROW(CalibrationRun(twoSteps(), kRest, kRest, {captures, 1e5, 5}),
                 std::invalid_argument);
  }
  for (const double bad : {0.0, -1.0, infinity, std::nan("")}) {
    EXPECT_THROW(CalibrationRun(twoSteps(), kRest, kRest, {3, bad, 5}), std::invalid_argument);
    EXPECT_THROW(CalibrationRun(twoSteps(), kRest, kRest, {3, 1e5, bad}), std::invalid_argument);
  }
}

}  // namespace
}  // namespace helix_arm::procedures
