#include "helix_arm/io/data_set.hpp"

#include <cstring>
#include <limits>
#include <random>

#include <gtest/gtest.h>

#include "helix_arm/io/fault_list.hpp"
#include "io/document/number.hpp"
#include "support/random.hpp"
#include "support/table_faults.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::io {
namespace {

DataSet load(const std::string& text) { return loadDataSet(test::TemporaryFile(text).path()); }

std::string faultsOf(const std::string& text) {
  return test::tableFaults(text, [](const std::string& path) { loadDataSet(path); });
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

TEST(DataSet, AllFaultsAreReportedWithTheirLines) {
  EXPECT_EQ(faultsOf("# c\nx_m,y_m\n1,nan\n1\n1,2,3\n,x\n4,inf\n5,6\n"),
            ":3 y_m is not a finite number; expected one\n:4 has 1 cells; expected 2, one per "
            "column\n:5 has 3 cells; expected 2, one per column\n:6 x_m is empty; expected a "
            "finite number\n:6 y_m is not a finite number; expected one\n:7 y_m is not a "
            "finite number; expected one");
  EXPECT_EQ(faultsOf("a_m,,a_m\n1,2,3\n"),
            ":1 column 3 has the name of column 1; expected each name once");
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
  for (const char* const name : {"Pressure_2_kpa", "presure_2_kpa", "p2_kpa"}) {
    EXPECT_EQ(meant(name), "pressure_2_kpa") << name;
  }
  EXPECT_EQ(meant("x_mm"), "x_m");
  EXPECT_EQ(meant("time_ms"), "time_s");
  for (const char* const name : {"temperature_c", "frame_id", "pressure_2_kpa", "x_target"}) {
    EXPECT_EQ(meant(name), "") << name;
  }
  // Beside the known one it is another quantity.
  EXPECT_EQ(faultsOf("x_m,x_mm\n1,2\n"), "");
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
