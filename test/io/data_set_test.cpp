#include "helix_arm/io/data_set.hpp"

#include <cstring>
#include <limits>
#include <random>

#include <gtest/gtest.h>

#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/number.hpp"
#include "support/random.hpp"
#include "support/refusal.hpp"
#include "support/table_faults.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::io {
namespace {

DataSet load(const std::string& text) { return loadDataSet(test::TemporaryFile(text).path()); }

std::string faultsOf(const std::string& text) {
  return test::tableFaults(text, [](const std::string& path) { loadDataSet(path); });
}

std::string refusalOf(const std::string& path) {
  return test::refusal<DocumentError>([&path] { loadDataSet(path); });
}

TEST(DataSet, ReadsColumnsRowsAndWhereTheyStand) {
  const DataSet data = load(
      "# a comment\n# another\npressure_1_kpa,curvature_rad\n0,0.5\n\n# between\n10.5, -1e-3\n");
  ASSERT_EQ(data.columns, (std::vector<std::string>{"pressure_1_kpa", "curvature_rad"}));
  ASSERT_EQ(data.values.rows(), 2);
  EXPECT_EQ(data.values.row(0), Eigen::RowVector2d(0, 0.5));
  EXPECT_EQ(data.values.row(1), Eigen::RowVector2d(10.5, -1e-3));
  EXPECT_EQ(data.lines, (std::vector<int>{4, 7}));
  EXPECT_EQ(data.find("curvature_rad"), 1);
  EXPECT_EQ(data.find("curvature"), -1);
}

TEST(DataSet, ReadsWhatASpreadsheetWrites) {
  const std::string text = "\xEF\xBB\xBF# comment\r\na_m,b_m\r\n1,2\r\n3,4";
  const DataSet data = load(text);
  EXPECT_EQ(data.sha256, sha256Of(text)) << "of the bytes that it was read from";
  ASSERT_EQ(data.columns, (std::vector<std::string>{"a_m", "b_m"}));
  EXPECT_EQ(data.values, (Eigen::Matrix2d() << 1, 2, 3, 4).finished());
}

TEST(DataSet, AllFaultsAreReportedWithTheirLines) {
  EXPECT_EQ(faultsOf("# c\na_m,b_m\n1,nan\n1\n1,2,3\n,x\n4,inf\n5,6\n"),
            ":3 column 2 is not a finite number; expected one\n:4 has 1 cells; expected 2, one per "
            "column\n:5 has 3 cells; expected 2, one per column\n:6 column 1 is empty; expected a "
            "finite number\n:6 column 2 is not a finite number; expected one\n:7 column 2 is not a "
            "finite number; expected one");
  EXPECT_EQ(faultsOf("a_m,,a_m\n1,2,3\n"),
            ":1 column 2 has no name; expected one with its unit\n"
            ":1 column 3 has the name of column 1; expected each name once");
}

TEST(DataSet, AFileWithoutATableIsAFault) {
  EXPECT_EQ(faultsOf(""), " has no header; expected a line of column names");
  EXPECT_EQ(faultsOf("# only a comment\n"), " has no header; expected a line of column names");
  EXPECT_EQ(faultsOf("a_m\n"), " has no rows; expected at least one below the header");
  EXPECT_EQ(refusalOf("/nowhere.csv"), "/nowhere.csv cannot be read: No such file or directory");
}

TEST(DataSet, NoNumberBecomesInfiniteInPascals) {
  EXPECT_EQ(faultsOf("a_kpa\n1e300\n-1e300\n"), "");
  EXPECT_EQ(faultsOf("a_kpa\n1e308\n-1e301\n"),
            ":2 column 1 is too large; expected at most 1e+300\n:3 column 1 is too large; expected "
            "at most 1e+300");
}

TEST(DataSet, AFileOfAnotherKindIsNotReadToItsEnd) {
  std::string text = "a_m\n";
  for (int i = 0; i < 100'000; ++i) text += "x\n";
  const std::string faults = faultsOf(text);
  EXPECT_NE(faults.find(" has 996 more faults"), std::string::npos) << faults.substr(0, 100);
}

TEST(DataSet, AFaultInEveryRowIsToldInAFewLinesWhichHideNoOther) {
  std::string text = "time_s,speed,trial\n";
  for (int i = 0; i < 200; ++i) text += "0.1,fast,run A\n";
  text += "now,fast,run A\n";
  const std::string told = " column 2 is not a finite number; expected one\n";
  std::string expected;
  for (int line = 2; line < 7; ++line) expected += ":" + std::to_string(line) + told;
  EXPECT_EQ(faultsOf(text), expected +
                                ":202 time_s is not a finite number; expected one\n"
                                " has 196 more faults");
}

TEST(DataSet, KnownColumnsAreNamedAndOthersAreCounted) {
  EXPECT_EQ(
      faultsOf("pressure_2_kpa,pressure_02_kpa,pressure_2000_kpa,x4_px,x5_px\nx,x,x,x,x\n"),
      ":2 pressure_2_kpa is not a finite number; expected one\n:2 pressure_02_kpa is not a finite "
      "number; expected one\n:2 column 3 is not a finite number; expected one\n:2 x4_px is "
      "not a finite number; expected one\n:2 column 5 is not a finite number; expected one");
}

TEST(DataSet, EveryLimitIsKeptFromBothSides) {
  const auto table = [](int columns, int rows) {
    std::string text = "c0", row = "1";
    for (int i = 1; i < columns; ++i) {
      text += ",c" + std::to_string(i);
      row += ",1";
    }
    text += "\n";
    for (int i = 0; i < rows; ++i) text += row + "\n";
    return text;
  };
  EXPECT_EQ(faultsOf(table(1000, 2)), "");
  EXPECT_EQ(faultsOf(table(1001, 2)), ":1 has 1001 columns; expected at most 1000");
  EXPECT_EQ(faultsOf(table(1, 200'000)), "");
  EXPECT_EQ(faultsOf(table(1, 200'001)),
            ":200002 is row 200001; expected at most 200000 rows: split the file");
  EXPECT_EQ(faultsOf(table(1000, 4000)), "");
  EXPECT_EQ(faultsOf(table(1000, 4001)),
            ":4002 is row 4001 of 1000 columns; expected at most 4000000 cells: split the file");
  EXPECT_EQ(faultsOf(std::string(200, 'n') + "\n1\n"), "");
  EXPECT_EQ(faultsOf("a," + std::string(201, 'n') + "\n1,1\n"),
            ":1 column 2 has 201 characters in its name; expected at most 200");
  EXPECT_EQ(faultsOf("a\n1" + std::string(999, '0') + "\n").find(" characters"), std::string::npos);
  EXPECT_EQ(faultsOf("a\n1" + std::string(1000, '0') + "\n"),
            ":2 column 1 has 1001 characters; expected at most 1000");
  EXPECT_EQ(faultsOf("#" + std::string((64U << 20U) - 6, ' ') + "\na\n1\n"), "");
  EXPECT_EQ(faultsOf("#" + std::string((64U << 20U) - 5, ' ') + "\na\n1\n"),
            " is larger than 64 MiB; expected a text file");
}

TEST(PressuresOf, TakesKilopascalsPascalsAndAMissingColumnAsVented) {
  const DataSet data = load("curvature_rad,pressure_3_kpa,pressure_1_kpa\n9,20,10.5\n9,0,-1\n");
  const Eigen::MatrixXd expected =
      (Eigen::MatrixXd(2, 3) << 10500, 0, 20000, -1000, 0, 0).finished();
  EXPECT_EQ(pressuresOf(data, 3), expected);
  const DataSet both = load("pressure_1_pa,pressure_2_kpa\n10500,20\n");
  EXPECT_EQ(pressuresOf(both, 2), (Eigen::MatrixXd(1, 2) << 10500, 20000).finished());
  EXPECT_THROW(pressuresOf(load("pressure_1_pa,pressure_1_kpa\n1,1\n"), 2), DocumentError);
}

TEST(LoadDataSet, ASkippedColumnMayHoldAnything) {
  const test::TemporaryFile file("a_m,status,b_m\n1,reached,2\n3,,4\n");
  const DataSet data = loadDataSet(file.path(), {"status"});
  EXPECT_EQ(data.columns, (std::vector<std::string>{"a_m", "b_m"}));
  EXPECT_EQ(data.values, (Eigen::MatrixXd(2, 2) << 1, 2, 3, 4).finished());
}

TEST(PressuresOf, RefusesColumnsThatFitNoActuator) {
  const auto message = [](const std::string& header, int actuators) {
    DataSet data;
    data.path = "data.csv";
    data.columns = {header};
    data.values.setZero(1, 1);
    return test::refusal<DocumentError>([&] { pressuresOf(data, actuators); });
  };
  EXPECT_EQ(message("pressure_1_kpa", 2), "accepted");
  EXPECT_EQ(message("curvature_rad", 2),
            "data.csv has no pressures; expected columns pressure_1_kpa to pressure_2_kpa");
  for (const char* column :
       {"pressure_3_kpa", "pressure_0_kpa", "pressure_1_psi", "pressure_01_kpa"}) {
    EXPECT_EQ(message(column, 2), std::string("data.csv ") + column +
                                      " belongs to no actuator; expected pressures in "
                                      "pressure_1_kpa to pressure_2_kpa");
  }
  EXPECT_EQ(message("pressure_of_a_secret", 2),
            "data.csv column 1 belongs to no actuator; expected pressures in pressure_1_kpa to "
            "pressure_2_kpa");
}

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
