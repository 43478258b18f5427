// What the board takes from its line, and what it answers: the profile `generic`.

#include "regulator/line_format.hpp"
#include "simulated_board.hpp"

namespace helix_arm::test {
namespace {

using regulator::withChecksum;

const std::string kRefused = withChecksum("?");

// The line with one bit flipped, its end included.
std::string flipped(const std::string& line, std::size_t bit) {
  std::string out = line + "\n";
  out[bit / 8] ^= static_cast<char>(1U << bit % 8);
  return out;
}

// What comes back for bytes that may hold no line end, or two.
std::string answerTo(SimulatedBoard& board, const std::string& bytes) {
  board.send(bytes);
  while (board.isReceiving()) board.advance(0.001);
  board.advance(0.11);  // after which the board forgets what is left on the line
  return board.receive();
}

TEST(BoardChecksum, ALineMayHaveOneAndAfterTheFirstEveryLineNeedsIt) {
  ReadyBoard board;
  EXPECT_EQ(board.ask("p0=close*0000"), "?");
  EXPECT_EQ(board.ask("p0?").back(), 'a') << "none is needed yet";
  const auto reading = regulator::withoutChecksum(board.ask(withChecksum("p0=close")));
  ASSERT_TRUE(reading);
  EXPECT_TRUE(std::regex_match(*reading, std::regex("p0=-?[0-9]+\\.[0-9]{2} kPa"))) << *reading;
  for (const char* line : {"p0?", "p0=100.00", "p0=vent", "p0?*0000", "p0=100.00*0000"}) {
    EXPECT_EQ(board.ask(line), kRefused) << line;
  }
  EXPECT_EQ(board.ask(withChecksum("p0=5x")), kRefused);
  EXPECT_EQ(board.ask(withChecksum("p0=300.01")), withChecksum("p0=fault above_limit"));
  EXPECT_FALSE(board.vents(0));
  EXPECT_TRUE(regulator::withoutChecksum(board.ask(withChecksum("p0=99999.99") + " \r")));
  board.chip().reset(SimulatedChip::Reset::kPin);
  board.advance(0.05);
  EXPECT_EQ(board.ask("p0=close"), "p0=fault restarted");
}

TEST(BoardChecksum, ABuildMayNeedItFromTheStart) {
  SimulatedBoard board(kChecksumRequired);
  board.advance(0.05);
  EXPECT_EQ(board.ask("p0=vent"), kRefused);
  EXPECT_EQ(board.ask(withChecksum("p0=close")), withChecksum("p0=fault restarted"));
  EXPECT_TRUE(regulator::withoutChecksum(board.ask(withChecksum("p0=vent"))));
}

TEST(BoardChecksum, EveryFlippedBitOfASetLineIsRefused) {
  ReadyBoard board;
  const std::string line = withChecksum("p0=100.00");
  for (std::size_t bit = 0; bit < 8 * (line.size() + 1); ++bit) {
    ASSERT_EQ(board.ask(withChecksum("p0=close")).substr(0, 3), "p0=");
    const std::string sent = flipped(line, bit), answer = answerTo(board, sent);
    EXPECT_TRUE(answer.empty() || answer == kRefused + "\n" ||
                answer == kRefused + "\n" + kRefused + "\n")
        << sent << " brings " << answer;
    EXPECT_FALSE(board.vents(0)) << sent;
  }
  EXPECT_LT(board.air().peak(), 1.0);
  for (int i = 0; i < 100; ++i) board.ask(line);
  EXPECT_NEAR(board.pressure(0), 1e5, 3e3) << "the line itself";
}

TEST(BoardLines, SetPointsAboveTheLimitAreRefusedByName) {
  ReadyBoard board;
  EXPECT_EQ(board.order(1, "300.01"), "p1=fault above_limit");
  EXPECT_EQ(board.order(1, "99999.99"), "p1=fault above_limit");
  board.advance(0.2);
  EXPECT_LT(board.pressure(1), 1.0);
  EXPECT_NE(board.order(1, "300.00"), "p1=fault above_limit");
  board.advance(0.2);
  EXPECT_GT(board.pressure(1), 1e5);
}

// Else the end of a line that a dead host began would be put in front of the next one's.
TEST(BoardLines, AHalfLineIsForgottenAfterAWhile) {
  ReadyBoard board;
  board.send("p0=1");
  board.advance(0.05);
  EXPECT_NE(board.ask("00.00"), "?") << "one line";
  board.order(0, "vent");
  board.send("p0=1");
  board.advance(0.15);
  EXPECT_EQ(board.ask("00.00"), "?");
  board.send("p0=1");
  board.advance(0.15);
  EXPECT_EQ(board.ask("p1?").substr(0, 3), "p1=");
}

// The chips' registers and interrupts of the line differ, what is made of a line does not.
class BoardUart : public testing::TestWithParam<BoardKind> {};
INSTANTIATE_TEST_SUITE_P(, BoardUart, testing::ValuesIn(kEachPart), nameOfKind);

// simavr's receiver holds 64 bytes, so that it overruns only where they come too fast for it.
TEST_P(BoardUart, ALineThatLostBytesIsRefused) {
  ReadyBoard board(GetParam());
  board.receive();
  std::string flood;
  for (int i = 0; i < 40; ++i) flood += "p0=120.00\n";
  for (const char byte : flood) board.chip().receive(static_cast<std::uint8_t>(byte));
  board.advance(0.3);
  const std::string answers = board.receive();
  EXPECT_NE(answers.find("?\n"), std::string::npos) << answers;
  EXPECT_EQ(board.ask("p0?").substr(0, 3), "p0=");
}

// Bytes of the protocol's own letters, so that some lines come close to it, or are of it.
TEST(BoardLines, JunkNeitherStopsTheBoardNorRaisesAPressureAboveTheLimit) {
  constexpr char kLetters[] = "p0123=?.\nventclos -e\r";
  std::mt19937 generator(17);
  std::uniform_int_distribution<int> byte(0, 255), letter(0, sizeof kLetters - 2);
  for (const bool letters : {false, true}) {
    ReadyBoard board;
    for (int i = 0; i < 20000; ++i) {
      board.send(std::string(
          1, static_cast<char>(letters ? kLetters[letter(generator)] : byte(generator))));
    }
    while (board.isReceiving()) board.advance(0.01);
    EXPECT_LT(board.air().peak(), 3.3e5) << letters;
    EXPECT_EQ(board.chip().watchdogResets(), 0);
    board.advance(0.2);
    board.ask("");
    EXPECT_EQ(board.ask("p0?").substr(0, 3), "p0=");
  }
}

TEST(BoardLines, AFloodOfJunkHoldsNoPressure) {
  ReadyBoard board;
  board.keep("200", 0.5);
  ASSERT_GT(board.pressure(0), 1.9e5);
  const double begin = board.time();
  std::string flood;
  for (int i = 0; i < 1200; ++i) flood += "xyzzy\n\xFFp1?\n";
  board.send(flood);
  while (!board.allVent() && board.isReceiving()) board.advance(0.001);
  EXPECT_NEAR(board.time() - begin, 0.5, 0.02);
  while (board.isReceiving()) board.advance(0.01);
  EXPECT_TRUE(board.allVent());
  EXPECT_LT(board.highest(), 5e3);
  EXPECT_EQ(board.chip().watchdogResets(), 0);
}

}  // namespace
}  // namespace helix_arm::test
