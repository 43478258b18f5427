#include "regulator/line_format.hpp"

#include <locale>
#include <sstream>

#include <gtest/gtest.h>

#include "helix_arm/regulator/config.hpp"
#include "support/refusal.hpp"

namespace helix_arm::regulator {
namespace {

using test::refusal;

const LineStyle kStyle{";", "kPa", 2};

std::optional<double> numberOf(const std::string& text) {
  const auto fields = LineFormat("p={pressure}").match("p=" + text, "", 1);
  return fields ? std::optional(fields->pressures.at(0)) : std::nullopt;
}

// The check value of CRC-16/IBM-3740 in the catalogue of CRC algorithms.
TEST(LineChecksum, IsTheCrc16OfTheLine) {
  EXPECT_EQ(withChecksum("123456789"), "123456789*29B1");
  EXPECT_EQ(withChecksum(""), "*FFFF");
  EXPECT_EQ(withoutChecksum("123456789*29B1 \r\n"), "123456789");
  for (const char* line : {"", "*", "*29B1", "123456789", "123456789*29b1", "123456789*29B",
                           "123456789 *29B1", "123456789*29B10", " 123456789*29B1"}) {
    EXPECT_EQ(withoutChecksum(line), std::nullopt) << line;
  }
}

TEST(LineFormat, NumbersAreWrittenWithTheirDecimals) {
  const struct {
    double value;
    int decimals;
    const char* text;
  } kCases[] = {{0, 2, "0.00"},
                {-0.001, 2, "0.00"},
                {0.005, 3, "0.005"},
                {-1.5, 0, "-2"},
                {413.6856, 3, "413.686"},
                {0.07, 2, "0.07"},
                {999999999, 6, "999999999.000000"}};
  for (const auto& entry : kCases) {
    EXPECT_EQ(LineFormat("{pressure}", {";", "", entry.decimals}).line("", {{entry.value}, {}, {}}),
              entry.text);
  }
}

TEST(LineFormat, DecimalNumbersAreReadExactly) {
  const struct {
    const char* text;
    double value;
  } kCases[] = {{"0", 0},
                {"+014.70", 14.7},
                {"-3", -3},
                {".5", 0.5},
                {"1.5E-3", 0.0015},
                {"413.6856", 413.6856},
                {"0.000000000000001", 1e-15}};
  for (const auto& entry : kCases) EXPECT_EQ(numberOf(entry.text), entry.value) << entry.text;
}

TEST(LineFormat, NonDecimalNumbersAreRefused) {
  std::istringstream words(
      "nan NaN -nan inf -inf infinity 0x10 1e 1e+ 1e400 1e999999999 1e-400 1e2147483648 . + - +-1 "
      "--1 1,5 1.2.3 1'000 1234567890123456 1.2345678901234567 0000000000000000000000000000001 1f "
      "1d one \xd9\xa1");
  for (std::string text; words >> text;) EXPECT_FALSE(numberOf(text)) << text;
  for (const char* text : {"", "1 5"}) EXPECT_FALSE(numberOf(text)) << text;
}

class DecimalComma : public std::numpunct<char> {
  char do_decimal_point() const override { return ','; }
  char do_thousands_sep() const override { return '.'; }
  std::string do_grouping() const override { return "\3"; }
};

TEST(LineFormat, TheLocaleDoesNotMatter) {
  const std::locale before = std::locale::global(std::locale(std::locale(), new DecimalComma));
  EXPECT_EQ(numberOf("1234.5"), 1234.5);
  EXPECT_FALSE(numberOf("1,5"));
  EXPECT_FALSE(numberOf("1.234,5"));
  EXPECT_EQ(LineFormat("{pressure}").line("", {{1234.5}, {}, {}}), "1234.50");
  std::locale::global(before);
}

TEST(LineFormat, BlanksAndEndsOfLinesDoNotMatterAndAnotherLineIsNoReading) {
  const LineFormat format("{address} {pressure} {set_point}{words}");
  for (const char* line : {"A +014.70 +020.00", "  A  +014.70\t+020.00  ", "\nA +014.70 +020.00\r",
                           "A +014.70 +020.00   HLD LCK", "A 14.7 20 HLD\r\n"}) {
    const auto fields = format.match(line, "A", 1);
    ASSERT_TRUE(fields) << line;
    EXPECT_EQ(fields->pressures, std::vector<double>{14.7});
    EXPECT_EQ(fields->set_point, 20.0);
  }
  for (const char* line :
       {"", "?", "A", "A +014.70", "B +014.70 +020.00", "A +014.70 +020.00 1",
        "A +014.70 +020.00HLD", "A +014.70 +020.00 HL2", "A+014.70 +020.00", "A +014.70 nan",
        "A nan +020.00", "AA +014.70 +020.00", "A +014.70 +020.00 HLD;"}) {
    EXPECT_FALSE(format.match(line, "A", 1)) << line;
  }
  EXPECT_TRUE(format.match("A +014.70 +02", "A", 1)) << "nothing shows that it is half a line";
}

TEST(LineFormat, TheNumberOfChannelsMustMatch) {
  const LineFormat format("{*}\t1\t{pressures}", {"\t", "", 2});
  EXPECT_TRUE(format.match("120\t1\t1.0\t2.0\t3.0\t", "", 3));
  EXPECT_FALSE(format.match("120\t1\t1.0\t2.0", "", 3));
  EXPECT_FALSE(format.match("120\t1\t1.0\t2.0\t3.0\t4.0", "", 3));
  EXPECT_FALSE(format.match("120\t0\t1.0\t2.0\t3.0", "", 3));
  EXPECT_FALSE(LineFormat("{pressures}").match("1;2;", "", 3));
  EXPECT_FALSE(LineFormat("{pressures}").match("1;;2", "", 3));
}

TEST(LineFormat, AnotherUnitIsRefused) {
  const LineFormat format("p={pressure} {unit}", kStyle);
  EXPECT_TRUE(format.match("p=1.0 kPa", "", 1));
  for (const char* line : {"p=1.0 psi", "p=1.0 kPaa", "p=1.0 kP", "p=1.0", "p=1.0 kpa"}) {
    EXPECT_FALSE(format.match(line, "", 1)) << line;
  }
}

// ---- Profiles: the lines of a device, its unit and its times ----

TEST(SerialProfile, UnitsAreConvertedBothWays) {
  SerialProfile profile;
  profile.pascals = 6894.757293168;
  EXPECT_NEAR(profile.toPascals(60), 413685.4, 0.1);  // 60 psi
  EXPECT_NEAR(profile.fromPascals(413685.43759), 60, 1e-9);
  profile.pascals = 100;
  profile.atmosphere = 101325;  // millibar from vacuum
  EXPECT_NEAR(profile.toPascals(1013.25), 0, 1e-9);
  EXPECT_NEAR(profile.fromPascals(1e5), 2013.25, 1e-9);
}

}  // namespace
}  // namespace helix_arm::regulator
