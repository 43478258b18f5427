#include "helix_arm/io/number.hpp"

#include <cstring>
#include <limits>
#include <random>

#include <gtest/gtest.h>

#include "support/random.hpp"

namespace helix_arm::io {
namespace {

TEST(Number, ReadsDecimals) {
  EXPECT_EQ(parseNumber("413.6856"), 413.6856);
  EXPECT_EQ(parseNumber("-1.5e-3"), -0.0015);
  EXPECT_EQ(parseNumber("+2"), 2.0);
  EXPECT_EQ(parseNumber(".5"), 0.5);
  EXPECT_EQ(parseNumber("0"), 0.0);
}

TEST(Number, RefusesTextOtherThanOneFiniteNumber) {
  for (const char* text : {"", " ", "1 ", " 1", "1.5 kPa", "1,5", "nan", ".nan", "inf", "-.inf",
                           "1e400", "0x10", "1_000", "--1", "1e", "one"}) {
    EXPECT_FALSE(parseNumber(text)) << '"' << text << '"';
  }
}

TEST(Number, FormattedTextReadsBackAsTheSameBits) {
  std::mt19937_64 generator(7);
  int tried = 0;
  while (tried < 20000) {
    const std::uint64_t bits = generator();
    double value;
    std::memcpy(&value, &bits, sizeof value);
    if (!std::isnormal(value)) continue;
    ++tried;
    ASSERT_EQ(parseNumber(formatNumber(value)), value) << formatNumber(value);
  }
  EXPECT_EQ(parseNumber(formatNumber(std::numeric_limits<double>::max())),
            std::numeric_limits<double>::max());
}

TEST(Number, FormattedTextIsShort) {
  EXPECT_EQ(formatNumber(0.1), "0.1");
  EXPECT_EQ(formatNumber(413.6856), "413.6856");
  EXPECT_EQ(formatNumber(-5), "-5");
}

TEST(Number, PascalsOfTheSameKilopascalsAreTheSame) {
  EXPECT_DOUBLE_EQ(pascals(413.6856), 413685.6);
  EXPECT_EQ(pascals(*parseNumber("413.6856")), pascals(413.6856));
}

TEST(Kilopascals, AreWhatPascalsWereMadeOf) {
  test::Random random(5);
  for (int i = 0; i < 100000; ++i) {
    const double kpa = random.uniform(-100, 1000);
    EXPECT_EQ(pascals(kilopascals(pascals(kpa))), pascals(kpa)) << kpa;
    const double pa = random.uniform(-1e5, 1e6);
    EXPECT_NEAR(pascals(kilopascals(pa)), pa, 2.3e-16 * std::abs(pa));
  }
  EXPECT_EQ(formatNumber(kilopascals(pascals(413.6856))), "413.6856");
}

}  // namespace
}  // namespace helix_arm::io
