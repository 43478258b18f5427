#include "helix_arm/io/data_set.hpp"

#include <cstring>
#include <limits>
#include <random>

#include <gtest/gtest.h>

#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/number.hpp"
#include "support/has.hpp"
#include "support/random.hpp"
#include "support/refusal.hpp"
#include "support/table_faults.hpp"
#include "support/temporary_file.hpp"
#include "support/test_size.hpp"

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
  EXPECT_EQ(faultsOf("# c\nx_m,y_m\n1,nan\n1\n1,2,3\n,x\n4,inf\n5,6\n"),
            ":3 y_m is not a finite number; expected one\n:4 has 1 cells; expected 2, one per "
            "column\n:5 has 3 cells; expected 2, one per column\n:6 x_m is empty; expected a "
            "finite number\n:6 y_m is not a finite number; expected one\n:7 y_m is not a "
            "finite number; expected one");
  EXPECT_EQ(faultsOf("a_m,,a_m\n1,2,3\n"),
            ":1 column 3 has the name of column 1; expected each name once");
}

TEST(DataSet, ColumnsThatNobodyReadsMayHoldAnything) {
  const DataSet data =
      load(",x_m,frame_id,speed,\n0,1,optitrack,nan,\n1,2,\"a, \"\"b\"\"\nc\",5,\n2,3,,6\n");
  EXPECT_EQ(data.columns, (std::vector<std::string>{"x_m"}));
  EXPECT_EQ(data.values, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(data.lines, (std::vector<int>{2, 3, 5}));
}

TEST(DataSet, CellsMayBeQuoted) {
  const DataSet data = load("\"x_m\", \"y_m\" \n\"1\", \"-2.5e-1\"\n");
  EXPECT_EQ(data.columns, (std::vector<std::string>{"x_m", "y_m"}));
  EXPECT_EQ(data.values, Eigen::RowVector2d(1, -0.25));
}

TEST(DataSet, WhereTheTipIsNotSeenItsPositionMayBeAnything) {
  const DataSet data = load("time_s,x_m,qx,seen\n0,NaN,,0\n1,2,3,1\n");
  EXPECT_EQ(data.values, (Eigen::MatrixXd(2, 4) << 0, 0, 0, 0, 1, 2, 3, 1).finished());
  EXPECT_EQ(faultsOf("time_s,x_m,seen\nnow,NaN,0\n1,NaN,1\n"),
            ":2 time_s is not a finite number; expected one\n"
            ":3 x_m is not a finite number; expected one");
}

TEST(DataSet, ANameThatIsNearlyAKnownOneIsAFault) {
  const auto meant = [](const std::string& name) {
    const std::string fault = faultsOf("curvature_rad," + name + "\n1,2\n");
    const std::string words = "is read by nothing; expected ";
    const std::size_t at = fault.find(words);
    return at == std::string::npos
               ? fault
               : fault.substr(at + words.size(), fault.find(',', at) - at - words.size());
  };
  for (const char* const name : {"Pressure_2_kpa", "pressure_2_kPa", "pressure2_kpa", "pressure_2",
                                 "presure_2_kpa", "PRESSURE_2_KPA", "p2_kpa", "pressure 2 [kPa]"}) {
    EXPECT_EQ(meant(name), "pressure_2_kpa") << name;
  }
  for (const auto& [name, known] : {std::pair("x_mm", "x_m"),
                                    {"X_m", "x_m"},
                                    {"x", "x_m"},
                                    {"time", "time_s"},
                                    {"time_ms", "time_s"},
                                    {"timestamp", "time_s"},
                                    {"lenght_m", "length_m"},
                                    {"length_mm", "length_m"},
                                    {"Trial", "trial"},
                                    {"qW", "qw"},
                                    {"captures", "capture"}}) {
    EXPECT_EQ(meant(name), known);
  }
  for (const char* const name : {"speed", "temperature_c", "frame_id", "pressure_2_kpa", "length_m",
                                 "force_n", "current_1_a", "comment", "tag_size", "x_target"}) {
    EXPECT_EQ(meant(name), "") << name;
  }
  // Beside the known one it is another quantity.
  EXPECT_EQ(faultsOf("x_m,x_mm\n1,2\n"), "");
}

TEST(DataSet, WhatIsNoTableOfOursIsNamed) {
  const auto expectNamed = [](const std::string& text, const char* words) {
    const std::string fault = faultsOf(text);
    EXPECT_NE(fault.find(words), std::string::npos) << text << fault;
    EXPECT_NE(fault.find("expected"), std::string::npos) << fault;
  };
  expectNamed("time_s;pressure_1_kpa;x_m\n0;1,5;0,18\n", ":1 is divided by semicolons");
  expectNamed("time_s\tx_m\n0\t1\n", ":1 is divided by tabs");
  expectNamed("0,0,0.18\n1,0,0.18\n", ":1 holds numbers alone");
  expectNamed("Recorded by me\nrig 2\ntime_s,x_m\n0,1\n",
              ":1 is above the header, which is line 3");
  expectNamed("version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "git lfs pull");
  expectNamed("Format Version,1.23,Take Name,arm\n\n,Type\n", "OptiTrack Motive");
  expectNamed("Trajectories\n100\n,,arm:tip\n", "Vicon Nexus");
  expectNamed("%time,field.header.seq\n1,2\n", "rostopic echo -p");
  expectNamed("name: rig\ncontractions:\n  a: {}\narm:\n  b: 1\n", "is a scene, not data");
}

TEST(DataSet, AFileWithoutATableIsAFault) {
  EXPECT_EQ(faultsOf(""), " has no header; expected a line of column names");
  EXPECT_EQ(faultsOf("# only a comment\n"), " has no header; expected a line of column names");
  EXPECT_EQ(faultsOf("a_m\n"), " has no rows; expected at least one below the header");
  EXPECT_EQ(refusalOf("/nowhere.csv"), "/nowhere.csv cannot be read: No such file or directory");
}

TEST(DataSet, NoNumberBecomesInfiniteInPascals) {
  EXPECT_EQ(faultsOf("x_m\n1e300\n-1e300\n"), "");
  EXPECT_EQ(faultsOf("x_m\n1e308\n-1e301\n"),
            ":2 x_m is too large; expected at most 1e+300\n:3 x_m is too large; expected "
            "at most 1e+300");
}

TEST(DataSet, AFileOfAnotherKindIsNotReadToItsEnd) {
  std::string text = "x_m\n";
  for (int i = 0; i < 100'000; ++i) text += "x\n";
  const std::string faults = faultsOf(text);
  EXPECT_NE(faults.find(" has 996 more faults"), std::string::npos) << faults.substr(0, 100);
}

TEST(DataSet, AFaultInEveryRowIsToldInAFewLinesWhichHideNoOther) {
  std::string text = "time_s,x_m,trial\n";
  for (int i = 0; i < 200; ++i) text += "0.1,fast,run A\n";
  text += "now,fast,run A\n";
  const std::string told = " x_m is not a finite number; expected one\n";
  std::string expected;
  for (int line = 2; line < 7; ++line) expected += ":" + std::to_string(line) + told;
  EXPECT_EQ(faultsOf(text), expected +
                                ":202 time_s is not a finite number; expected one\n"
                                " has 196 more faults");
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
  if (test::isFullSize()) {
    EXPECT_EQ(faultsOf(table(1000, 4000)), "");
    EXPECT_EQ(faultsOf(table(1000, 4001)),
              ":4002 is row 4001 of 1000 columns; expected at most 4000000 cells: split the file");
  }
  EXPECT_EQ(faultsOf(std::string(200, 'n') + "\n1\n"), "");
  EXPECT_EQ(faultsOf("a," + std::string(201, 'n') + "\n1,1\n"),
            ":1 column 2 has 201 characters in its name; expected at most 200");
  EXPECT_EQ(faultsOf("qx\n1" + std::string(999, '0') + "\n").find(" characters"),
            std::string::npos);
  EXPECT_EQ(faultsOf("qx\n1" + std::string(1000, '0') + "\n"),
            ":2 qx has 1001 characters; expected at most 1000");
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

TEST(PressuresOf, NamesThePressuresThatCountAsVented) {
  const DataSet data = load("curvature_rad,pressure_3_kpa,pressure_1_pa\n9,20,10\n");
  EXPECT_EQ(missingPressures(data, 4),
            (std::vector<std::string>{"pressure_2_kpa", "pressure_4_kpa"}));
  EXPECT_EQ(missingText(data, 3),
            data.path + " has no column pressure_2_kpa, which counts as 0 kPa");
  EXPECT_EQ(missingText(load("time_s,x_m\n1,2\n"), 3), "") << "a series without pressures";
}

TEST(HistoryOf, TimesThatCannotBeSecondsNameTheirUnit) {
  for (const auto& [time, unit] : {std::pair("1700000000123", "milliseconds"),
                                   {"1700000000123456", "microseconds"},
                                   {"1700000000123456789", "nanoseconds"}}) {
    const DataSet data = load(std::string("time_s,pressure_1_kpa\n") + time + ",1\n");
    EXPECT_TRUE(test::has(test::refusal<DocumentError>([&] { historyOf(data, 1); }), unit)) << time;
  }
  EXPECT_EQ(historyOf(load("time_s,pressure_1_kpa\n1.7e9,1\n"), 1).time.front(), 1.7e9);
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
    const std::string expected =
        std::string("data.csv column '") + column +
        "' belongs to no actuator; expected pressures in pressure_1_kpa to "
        "pressure_2_kpa";
    EXPECT_EQ(message(column, 2).substr(0, expected.size()), expected);
  }
  EXPECT_TRUE(test::has(message("pressure_1_psi", 2), "multiply it by 6.894757"));
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
