// The board with the driver and the safety core of an arm: what each fault comes to on both sides.
#include <cstdio>
#include <functional>
#include <random>
#include <set>

#include <gtest/gtest.h>

#include "board_kinds.hpp"
#include "board_rig.hpp"

namespace helix_arm::test {
namespace {

using control::SafetyState;
using Causes = std::set<std::string>;

constexpr double kGoal = 1.5e5, kHighest = 4e5;  // [Pa]
constexpr double kWatched = 0.5;                 // of the board: silence until it vents [s]

void failFirst(BoardRig& rig, ChannelFault fault) {
  rig.with([&](SimulatedBoard& board) { board.air().fail(0, fault); });
}

// Bytes in between that nobody sent.
LiveBoard::Damage noise() {
  return [generator = std::mt19937(5)](const std::string& bytes) mutable {
    std::uniform_int_distribution<int> byte(0, 255);
    std::string out;
    for (const char sent : bytes) {
      out += sent;
      if (byte(generator) < 64) out += static_cast<char>(byte(generator));
    }
    return out;
  };
}

// Lines end half-way.
std::string halve(const std::string& bytes) { return bytes.substr(0, bytes.size() / 2); }

// Between two lines of the host come a hundred of somebody else.
std::string flood(const std::string& bytes) {
  std::string out;
  for (int i = 0; i < 100; ++i) out += "xyzzy?\n";
  return out + bytes;
}

struct Row {
  const char* name;
  Causes causes;        ///< of the host, any of them; empty: it stays enabled
  double vents_within;  ///< all channels, by the board's own record [s]
  std::function<void(BoardRig&)> fail, mend;
};

std::string nameOfRow(const testing::TestParamInfo<Row>& info) { return info.param.name; }

void PrintTo(const Row& row, std::ostream* out) { *out << row.name; }

class BoardAndDriver : public testing::TestWithParam<Row> {};

TEST_P(BoardAndDriver, EndVentedAndNothingMovesUntilEnabledAgain) {
  constexpr double kLongest = 3;  // [s]
  const Row& row = GetParam();
  BoardRig rig(kSmallBoard);
  ASSERT_EQ(rig.bringTo(kGoal), "");
  rig.with([](SimulatedBoard& board) { board.air().forgetPeak(); });

  row.fail(rig);
  const double begin = rig.board().time();
  double vents = kLongest;
  const auto turn = [&] {
    rig.turn();
    const bool vented = rig.with([](SimulatedBoard& board) { return board.allVent(); });
    if (vented && rig.state() != SafetyState::kEnabled) {
      vents = std::min(vents, rig.board().time() - begin);
    }
  };
  while (rig.state() == SafetyState::kEnabled && rig.board().time() < begin + kLongest) turn();
  const double fault = rig.board().time() - begin;
  const std::string cause = rig.cause(), error = rig.error();
  while (vents == kLongest && rig.board().time() < begin + kLongest) turn();
  EXPECT_TRUE(row.causes.count(cause)) << cause << ": " << rig.core().reason() << "; " << error;
  EXPECT_LT(vents, row.vents_within);

  row.mend(rig);
  rig.board().damage(nullptr);
  EXPECT_TRUE(rig.reaches(SafetyState::kVented, 5)) << rig.core().reason() << rig.error();
  EXPECT_LT(rig.with([](SimulatedBoard& board) { return board.highest(); }), 2e4);
  const double peak = rig.with([](SimulatedBoard& board) { return board.air().peak(); });
  EXPECT_LT(peak, kHighest);
  EXPECT_EQ(rig.bringTo(kGoal), "");
  std::printf("[  FIGURE  ] %s: %s after %.0f ms, all vent after %.0f ms, peak %.0f kPa; %s\n",
              row.name, cause.c_str(), 1e3 * fault, 1e3 * vents, peak / 1e3, error.c_str());
}

const Causes kLine = {"stale_reading", "regulator_lost"};
const Causes kReading = {"not_following", "leak", "regulator_lost", "stale_reading"};
const auto kNothing = [](BoardRig&) {};

Row onChannel(const char* name, Causes causes, double vents_within, ChannelFault fault) {
  return {name, std::move(causes), vents_within, [=](BoardRig& rig) { failFirst(rig, fault); },
          [](BoardRig& rig) { failFirst(rig, ChannelFault::kNone); }};
}

INSTANTIATE_TEST_SUITE_P(
    , BoardAndDriver,
    testing::Values(
        Row{"host_silent", kReading, 0.1, [](BoardRig& rig) { rig.board().pass(kWatched + 0.02); },
            kNothing},
        Row{"line_noisy", kReading, 1.0, [](BoardRig& rig) { rig.board().damage(noise()); },
            kNothing},
        Row{"half_lines", kLine, 1.0, [](BoardRig& rig) { rig.board().damage(halve); }, kNothing},
        Row{"reset", kReading, 0.3,
            [](BoardRig& rig) {
              rig.with([](SimulatedBoard& b) { b.chip().reset(SimulatedChip::Reset::kPin); });
            },
            kNothing},
        Row{"hang", kReading, 0.3,
            [](BoardRig& rig) { rig.with([](SimulatedBoard& b) { b.chip().hang(); }); }, kNothing},
        Row{"brown_out", kLine, 0.3,
            [](BoardRig& rig) { rig.with([](SimulatedBoard& b) { b.setVoltage(3.5); }); },
            [](BoardRig& rig) { rig.with([](SimulatedBoard& b) { b.setVoltage(5); }); }},
        onChannel("inlet_stuck_open", {"over_limit", "not_following", "regulator_lost"}, 0.8,
                  ChannelFault::kInletStuckOpen),
        onChannel("outlet_stuck_open", kReading, 1.5, ChannelFault::kOutletStuckOpen),
        onChannel("sensor_open", kLine, 0.6, ChannelFault::kSensorOpen),
        onChannel("sensor_shorted_to_ground", kLine, 0.6, ChannelFault::kSensorShortedToGround),
        onChannel("sensor_shorted_to_supply", kLine, 0.6, ChannelFault::kSensorShortedToSupply)),
    nameOfRow);

// These show once the pressure is to move.
TEST(BoardAndHost, AnInletThatStaysShutOrASensorThatIsBlockedIsNotFollowed) {
  for (const ChannelFault fault : {ChannelFault::kInletStuckShut, ChannelFault::kSensorBlocked}) {
    BoardRig rig(kSmallBoard);
    ASSERT_EQ(rig.bringTo(1e5), "");
    failFirst(rig, fault);
    rig.setGoal(2.5e5);
    ASSERT_TRUE(rig.reaches(SafetyState::kFault, 2));
    EXPECT_TRUE(rig.cause() == "not_following" || rig.cause() == "regulator_lost") << rig.cause();
    rig.turn();
    EXPECT_TRUE(rig.with([](SimulatedBoard& board) { return board.allVent(); }));
    failFirst(rig, ChannelFault::kNone);
    EXPECT_TRUE(rig.reaches(SafetyState::kVented, 5));
    EXPECT_LT(rig.with([](SimulatedBoard& board) { return board.air().peak(); }), kHighest);
    EXPECT_EQ(rig.bringTo(1e5), "");
  }
}

TEST(BoardAndHost, AnOutletThatStaysShutIsReportedAsSuch) {
  BoardRig rig(kSmallBoard);
  ASSERT_EQ(rig.bringTo(kGoal), "");
  failFirst(rig, ChannelFault::kOutletStuckShut);
  rig.core().vent(rig.board().time());
  EXPECT_FALSE(rig.reaches(SafetyState::kVented, 4));
  EXPECT_TRUE(rig.core().report().vent_overdue);
  failFirst(rig, ChannelFault::kNone);
  EXPECT_TRUE(rig.reaches(SafetyState::kVented, 2));
}

TEST(BoardAndHost, AFloodOfForeignLinesNeitherMovesNorStopsTheArm) {
  BoardRig rig(kSmallBoard);
  ASSERT_EQ(rig.bringTo(kGoal), "");
  rig.board().damage(flood);
  rig.setGoal(0.8e5);
  const double end = rig.board().time() + 2;
  while (rig.board().time() < end) rig.turn();
  rig.board().damage(nullptr);
  EXPECT_LT(rig.with([](SimulatedBoard& board) { return board.air().peak(); }), 1.6e5);
  rig.core().vent(rig.board().time());
  EXPECT_TRUE(rig.reaches(SafetyState::kVented, 5)) << rig.core().reason() << rig.error();
  EXPECT_EQ(rig.bringTo(kGoal), "");
}

TEST(BoardAndHost, ALimitBelowTheHostsIsNamed) {
  LiveBoard board(kSmallBoard);
  board.pass(0.1);
  regulator::AsciiSerialDriver driver({genericProfile(), board.path(), {"0", "1", "2"}}, 3);
  driver.connect();
  control::ValveOrders orders(3);
  orders.valve.assign(3, control::Valve::kRegulate);
  orders.set_point.setConstant(3.5e5);
  try {
    driver.write(orders);
    FAIL() << "a set point above the limit was taken";
  } catch (const regulator::BadReply& error) {
    EXPECT_NE(std::string(error.what()).find("p0=fault above_limit"), std::string::npos)
        << error.what();
  }
}

TEST(BoardAndHost, EightChannelsAreFollowed) {
  BoardRig rig(kBoardKinds[2]);
  EXPECT_EQ(rig.bringTo(2e5), "");
  EXPECT_EQ(rig.bringTo(0.5e5), "");
}

}  // namespace
}  // namespace helix_arm::test
