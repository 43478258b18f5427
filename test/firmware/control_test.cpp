// How pressures follow their set points, and what it takes to move them at all.
#include <cstdio>

#include "simulated_board.hpp"

namespace helix_arm::test {
namespace {

constexpr double kDeadBand = 2.5e3, kNoise = 500;  // of the board and of its readings [Pa]

struct Step {
  double overshoot = 0, steady_error = 0, time = 0;  // [Pa], [Pa], [s] to within 5 kPa
};

// All channels go from one set point [kPa] to the next.
Step follow(ReadyBoard& board, double from, double to) {
  constexpr double kDuration = 1.5, kSteady = 1.2, kNear = 5e3;
  Step worst;
  std::vector<double> there(static_cast<std::size_t>(board.channels()), kDuration);
  const double begin = board.time();
  for (double time = 0; time < kDuration; time = board.time() - begin) {
    board.order(0, std::to_string(to));
    for (int i = 1; i < board.channels(); ++i) {
      board.send("p" + std::to_string(i) + "=" + std::to_string(to) + "\n");
    }
    for (int i = 0; i < board.channels(); ++i) {
      double& reached = there[static_cast<std::size_t>(i)];
      const double error = board.pressure(i) - 1e3 * to;
      worst.overshoot = std::max(worst.overshoot, to > from ? error : -error);
      if (time > kSteady) worst.steady_error = std::max(worst.steady_error, std::abs(error));
      if (std::abs(error) < kNear) reached = std::min(reached, time);
    }
  }
  worst.time = *std::max_element(there.begin(), there.end());
  return worst;
}

class BoardLoop : public testing::TestWithParam<BoardKind> {};

TEST_P(BoardLoop, PressuresFollowTheirSetPoints) {
  ReadyBoard board(GetParam());
  Step worst;
  double from = 0;
  for (const double to : {100., 200., 300., 50., 120., 20., 150., 30., 290., 10., 280.}) {
    const Step step = follow(board, from, to);
    EXPECT_LT(step.steady_error, kDeadBand + kNoise) << from << " to " << to;
    EXPECT_LT(step.overshoot, 6e3) << from << " to " << to;
    EXPECT_LT(step.time, 0.8) << from << " to " << to;
    worst.steady_error = std::max(worst.steady_error, step.steady_error);
    worst.overshoot = std::max(worst.overshoot, step.overshoot);
    worst.time = std::max(worst.time, step.time);
    from = to;
  }
  std::printf(
      "[  FIGURE  ] %s: steady error %.1f kPa, overshoot %.1f kPa, within 5 kPa after %.2f s\n",
      GetParam().name().c_str(), worst.steady_error / 1e3, worst.overshoot / 1e3, worst.time);
}

INSTANTIATE_TEST_SUITE_P(, BoardLoop, testing::ValuesIn(drawnBoards()), nameOfKind);

class BoardControl : public testing::TestWithParam<BoardKind> {};

TEST_P(BoardControl, StartsVentedAndMovesNothingUntilItWasToldToVent) {
  SimulatedBoard board(GetParam());
  board.advance(0.05);
  for (int i = 0; i < board.channels(); ++i) {
    const std::string name = "p" + std::to_string(i);
    EXPECT_EQ(board.ask(name + "=100.00"), name + "=fault restarted");
    EXPECT_EQ(board.ask(name + "=close"), name + "=fault restarted");
    EXPECT_NE(board.ask(name + "?").find(" kPa"), std::string::npos);
  }
  board.advance(0.3);
  EXPECT_TRUE(board.allVent());
  EXPECT_FALSE(board.isSupplied());
  EXPECT_LT(board.air().peak(), 1.0);
}

TEST_P(BoardControl, AClosedChannelKeepsItsPressureAndAVentedOneLosesIt) {
  ReadyBoard board(GetParam());
  board.keep("150", 1);
  board.keep("close", 0.1);
  const double closed = board.pressure(0);
  board.keep("close", 1);
  EXPECT_EQ(board.pressure(0), closed);
  board.keep("vent", 1);
  EXPECT_LT(board.highest(), 2e3);
  EXPECT_FALSE(board.isSupplied());
  // A set point of zero lets all air out as well.
  board.keep("150", 1);
  board.keep("0", 1.5);
  EXPECT_LT(board.highest(), 200);
}

TEST_P(BoardControl, TheLineIsWatchedForHalfASecond) {
  ReadyBoard board(GetParam());
  board.keep("200", 0.7);
  board.order(0, "200");
  board.receive();
  board.advance(0.47);
  EXPECT_FALSE(board.vents(0));
  board.advance(0.03);
  EXPECT_TRUE(board.allVent());
  EXPECT_FALSE(board.isSupplied());
  board.advance(1);
  EXPECT_LT(board.highest(), 3e3);
  // What went by itself comes back by an order alone.
  EXPECT_EQ(board.order(0, "200"), "p0=fault line_lost");
  EXPECT_EQ(board.order(0, "close"), "p0=fault line_lost");
  board.order(0, "vent");
  board.order(0, "200");
  board.advance(0.3);
  EXPECT_GT(board.pressure(0), 1.9e5);
  EXPECT_LT(board.pressure(1), 3e3);
}

// A host that only reads commands nothing.
TEST_P(BoardControl, ReadingDoesNotHoldAPressure) {
  ReadyBoard board(GetParam());
  board.keep("200", 0.7);
  const double begin = board.time();
  while (!board.allVent() && board.time() < begin + 1) board.ask("p0?");
  EXPECT_LT(board.time() - begin, 0.53);
  EXPECT_TRUE(board.allVent());
}

// Else the pins without a sensor would count as broken ones.
TEST(BoardForFewerChannels, HasNoOthers) {
  ReadyBoard board(kFiveChannels);
  board.keep("100", 1);
  EXPECT_EQ(board.ask("p5?"), "?");
  for (int i = 0; i < board.channels(); ++i) EXPECT_NEAR(board.pressure(i), 1e5, 3e3) << i;
  for (int i = 0; i < 30; ++i) {
    board.keep("100", 0.05);
    EXPECT_TRUE(board.isLit()) << "steady: no fault";
  }
}

INSTANTIATE_TEST_SUITE_P(, BoardControl, testing::ValuesIn(drawnBoards()), nameOfKind);

}  // namespace
}  // namespace helix_arm::test
