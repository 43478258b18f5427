// What the board does by itself when its parts fail, without a host's help.
#include "simulated_board.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::test {
namespace {

constexpr double kSetPointLimit = 3e5, kNever = 4e5;  // of the firmware; of these muscles [Pa]

// Time until it holds, 2 s at most [s].
double timeUntil(ReadyBoard& board, const std::function<bool()>& condition,
                 const std::string& order = "") {
  const double begin = board.time();
  while (!condition() && board.time() < begin + 2) {
    if (order.empty()) {
      board.advance(0.0005);
    } else {
      board.orderAll(order);
    }
  }
  return board.time() - begin;
}

class BoardFaults : public testing::TestWithParam<BoardKind> {
 protected:
  // Every muscle at a set point [kPa].
  void bringTo(const std::string& set_point) {
    board_.keep(set_point, 1);
    ASSERT_NEAR(board_.pressure(0), 1e3 * std::stod(set_point), 5e3);
  }
  // With all parts sound again.
  void expectRecovery(const std::string& set_point = "100") {
    for (int i = 0; i < board_.channels(); ++i) board_.air().fail(i, ChannelFault::kNone);
    board_.advance(2);
    board_.ventAll();
    bringTo(set_point);
  }

  ReadyBoard board_{GetParam()};
};

TEST_P(BoardFaults, ABrokenSensorVentsItsChannelAndIsNamed) {
  struct Row {
    ChannelFault fault;
    const char* name;
  };
  for (const Row& row : {Row{ChannelFault::kSensorOpen, "sensor_low"},
                         Row{ChannelFault::kSensorShortedToGround, "sensor_low"},
                         Row{ChannelFault::kSensorShortedToSupply, "sensor_high"}}) {
    bringTo("150");
    board_.air().forgetPeak();
    board_.air().fail(1, row.fault);
    board_.order(0, "150");
    EXPECT_LT(timeUntil(board_, [&] { return board_.vents(1); }), 0.03) << row.name;
    EXPECT_FALSE(board_.vents(0));
    board_.advance(0.03);  // it may bleed before it knows
    const std::string fault = std::string("p1=fault ") + row.name;
    EXPECT_EQ(board_.ask("p1?"), fault);
    EXPECT_EQ(board_.order(1, "100"), fault);
    EXPECT_EQ(board_.order(1, "vent"), fault) << "it cannot be read";
    board_.keep("100", 0.5);
    EXPECT_LT(board_.pressure(1), 2e4);
    EXPECT_NEAR(board_.pressure(0), 1e5, 3e3);
    EXPECT_LT(board_.air().peak(), kSetPointLimit);

    board_.air().fail(1, ChannelFault::kNone);
    board_.advance(0.05);
    EXPECT_EQ(board_.order(1, "100"), fault) << "until it was told to vent";
    expectRecovery();
  }
}

// Its hose is off or bent: it tells no pressure, however much there is.
TEST_P(BoardFaults, AMuscleThatIsFedWithoutAReadingThatRisesIsVented) {
  board_.air().fail(0, ChannelFault::kSensorBlocked);
  const double begin = board_.time();
  board_.orderAll("100");
  ASSERT_FALSE(board_.vents(0));
  timeUntil(
      board_, [&] { return board_.vents(0); }, "100");
  EXPECT_LT(board_.time() - begin, 0.4);
  EXPECT_EQ(board_.order(0, "100"), "p0=fault not_rising");
  EXPECT_NE(board_.ask("p0?").find(" kPa"), std::string::npos);
  EXPECT_LT(board_.air().peak(), kNever);
  board_.keep("100", 1);
  EXPECT_LT(board_.pressure(0), 5e3);
  EXPECT_NEAR(board_.pressure(1), 1e5, 3e3);
  // Wherever it stands, and however little is missing.
  for (const auto& [at, set_point] : {std::pair{"100", "300"}, {"275", "300"}, {"290", "297"}}) {
    expectRecovery(at);
    board_.air().forgetPeak();
    board_.air().fail(0, ChannelFault::kSensorBlocked);
    board_.keep(set_point, 2);
    EXPECT_EQ(board_.order(0, set_point), "p0=fault not_rising") << at;
    EXPECT_LT(board_.air().peak(), kNever) << at;
  }
}

TEST_P(BoardFaults, AnInletThatStaysShutIsNamedAndHarmsNobody) {
  board_.air().fail(0, ChannelFault::kInletStuckShut);
  board_.keep("100", 1);
  EXPECT_EQ(board_.order(0, "100"), "p0=fault not_rising");
  EXPECT_NEAR(board_.pressure(1), 1e5, 3e3);
  expectRecovery();
}

TEST_P(BoardFaults, AnInletThatStaysOpenTripsAllAndShutsTheSupply) {
  bringTo("250");
  board_.air().forgetPeak();
  board_.air().fail(0, ChannelFault::kInletStuckOpen);
  const auto tripped = [&] { return !board_.isSupplied(); };
  EXPECT_LT(timeUntil(board_, tripped, "close"), 0.5);
  EXPECT_TRUE(board_.allVent());
  EXPECT_LT(board_.air().peak(), kNever);
  std::printf("[  FIGURE  ] %s: peak with an inlet stuck open %.0f kPa\n",
              GetParam().name().c_str(), board_.air().peak() / 1e3);
  EXPECT_EQ(board_.order(0, "100"), "p0=fault over_pressure");
  EXPECT_EQ(board_.order(1, "100"), "p1=fault over_pressure") << "the supply is all channels'";
  EXPECT_EQ(board_.order(0, "vent").find("fault"), std::string::npos) << "the pressure is read";
  EXPECT_EQ(board_.order(0, "100"), "p0=fault over_pressure") << "while it stands";
  board_.keep("vent", 1);
  EXPECT_LT(board_.highest(), 1e4);
  EXPECT_FALSE(board_.isSupplied());

  board_.orderAll("close");  // it may be tried again
  ASSERT_TRUE(board_.isSupplied());
  EXPECT_LT(timeUntil(board_, tripped, "close"), 2);
  expectRecovery();
}

TEST_P(BoardFaults, AnOutletThatStaysOpenOrABurstMuscleIsFedNoLongerThanARiseTakes) {
  bringTo("150");
  board_.air().forgetPeak();
  board_.air().fail(0, ChannelFault::kOutletStuckOpen);
  board_.keep("300", 1.5);
  EXPECT_EQ(board_.order(0, "300"), "p0=fault not_rising");
  EXPECT_LT(board_.air().peak(), kSetPointLimit + 1e4);
}

TEST_P(BoardFaults, AnOutletThatStaysShutIsFedNoMore) {
  bringTo("150");
  board_.air().forgetPeak();
  board_.air().fail(0, ChannelFault::kOutletStuckShut);
  board_.keep("50", 1);
  EXPECT_LT(board_.pressure(1), 6e4);
  EXPECT_LT(board_.air().peak(), 1.6e5);
  const double reading = std::stod(board_.ask("p0?").substr(3));
  EXPECT_NEAR(reading, 150, 5) << "the host sees it";
}

TEST_P(BoardFaults, AProgramThatHangsIsResetByItsChipAndComesBackVented) {
  for (const char* set_point : {"150", "300"}) {
    bringTo("100");
    board_.orderAll(set_point);
    board_.advance(0.02);
    board_.air().forgetPeak();
    const int before = board_.chip().watchdogResets();
    board_.chip().hang();
    const double time = timeUntil(board_, [&] { return board_.allVent(); });
    EXPECT_LT(time, 0.025);
    EXPECT_EQ(board_.chip().watchdogResets(), before + 1);
    board_.advance(0.1);
    EXPECT_EQ(board_.order(0, "100"), "p0=fault restarted");
    board_.advance(1);
    EXPECT_TRUE(board_.allVent());
    EXPECT_LT(board_.air().peak(), kSetPointLimit);
    EXPECT_EQ(board_.chip().watchdogResets(), before + 1);
    board_.ventAll();
  }
}

TEST_P(BoardFaults, AResetVentsAtOnceAndNothingComesBackByItself) {
  bringTo("200");
  board_.send("p0=2");  // in the middle of a line
  board_.advance(0.001);
  board_.chip().reset(SimulatedChip::Reset::kPin);
  EXPECT_TRUE(board_.allVent());
  board_.advance(0.05);
  EXPECT_EQ(board_.ask("00.00"), "?");
  EXPECT_EQ(board_.order(1, "200"), "p1=fault restarted");
  board_.keep("200", 1);
  EXPECT_LT(board_.highest(), 5e3);
  board_.ventAll();
  bringTo("100");
}

TEST_P(BoardFaults, ABrownOutVentsWhileItLastsAndAfterwards) {
  bringTo("200");
  board_.setVoltage(3.5);
  EXPECT_TRUE(board_.allVent());
  EXPECT_EQ(board_.ask("p0?"), "");
  board_.advance(0.3);
  const double low = board_.highest();
  EXPECT_LT(low, 1e5);
  board_.setVoltage(5);
  board_.advance(0.05);
  EXPECT_EQ(board_.order(0, "200"), "p0=fault restarted");
  EXPECT_TRUE(board_.allVent());
  for (int i = 0; i < 20; ++i) {  // a supply that comes and goes
    board_.setVoltage(i % 2 == 0 ? 3.5 : 5);
    board_.advance(0.013 * i);
    EXPECT_TRUE(board_.allVent());
  }
  EXPECT_LT(board_.highest(), low);
  board_.setVoltage(5);
  board_.advance(0.05);
  board_.ventAll();
  bringTo("100");
}

// They reset at brown-out and keep the watchdog on, which the simulated chip obeys by hand, and are
// those that a reader burns, of `make fuses` and of the document.
TEST_P(BoardFaults, TheFusesOfTheElfAreThoseThatAreFlashed) {
  constexpr std::uint8_t kWatchdogAlwaysOn = 1 << 4, kBrownOutLevel = 0x07, kBrownOut43 = 0x04;
  const auto fuses = board_.chip().fuses();
  EXPECT_EQ(fuses[1] & kWatchdogAlwaysOn, 0) << "programmed: 0";
  EXPECT_EQ(fuses[2] & kBrownOutLevel, kBrownOut43);
  constexpr const char* kNames[] = {"lfuse", "hfuse", "efuse"};
  for (const char* path :
       {HELIX_ARM_SOURCE_DIR "/firmware/Makefile", HELIX_ARM_SOURCE_DIR "/docs/board.md"}) {
    const std::string text = contentOf(path);
    for (std::size_t i = 0; i < fuses.size(); ++i) {
      std::smatch match;
      const std::regex value(std::string(kNames[i]) + R"([^\n]*?0x([0-9A-F]{2}))");
      ASSERT_TRUE(std::regex_search(text, match, value)) << path << " lacks " << kNames[i];
      EXPECT_EQ(std::stoi(match[1], nullptr, 16), fuses[i]) << path << " " << kNames[i];
    }
  }
}

TEST_P(BoardFaults, ASupplyThatFallsIsNoOverPressure) {
  bringTo("200");
  board_.air().setSupply(5e4);
  board_.keep("250", 0.3);
  EXPECT_LT(board_.highest(), 2.1e5);
  board_.keep("250", 0.7);
  EXPECT_EQ(board_.order(0, "250"), "p0=fault not_rising");
  board_.air().setSupply(5e5);
  expectRecovery();
}

INSTANTIATE_TEST_SUITE_P(, BoardFaults, testing::ValuesIn(drawnBoards()), nameOfKind);

}  // namespace
}  // namespace helix_arm::test
