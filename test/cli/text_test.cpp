// Results for people: names and units by the keys of a report.
#include <sstream>

#include <gtest/gtest.h>

#include "cli/output.hpp"

namespace helix_arm::test {
namespace {

using nlohmann::json;

std::string textOf(const json& report) {
  std::ostringstream out;
  cli::printText(report, out);
  return out.str();
}

TEST(Text, KeysGiveNamesUnitsAndOrder) {
  EXPECT_EQ(textOf({{"out", "b.yaml"},
                    {"warnings", {"slow", "late"}},
                    {"scene", "demo"},
                    {"rms_m", 0.0125},
                    {"supply_pa", 5e5},
                    {"time_s", json()},
                    {"passed", true},
                    {"empty", json::array()},
                    {"tip", {{"position_m", {0.36, -1e-12, 0.02}}, {"turned_rad", 1.0}}}}),
            "scene         demo\n"
            "passed        yes\n"
            "warning       slow, late\n"
            "rms           12.5 mm\n"
            "supply        500 kPa\n"
            "tip position  360.000, 0.000, 20.000 mm\n"
            "tip turned    57.2958 deg\n"
            "written       b.yaml\n");
}

TEST(Text, ListsOfObjectsAreTables) {
  EXPECT_EQ(textOf({{"states",
                     {{{"state", "open"}, {"time_s", 0.01}, {"tip_m", json()}},
                      {{"state", "closed"}, {"time_s", 12.5}, {"tip_m", json()}}}}}),
            "states:\n"
            "  state   time [s]\n"
            "  open        0.01\n"
            "  closed      12.5\n");
  EXPECT_EQ(textOf({{"parameters", {{"fx", {{"value", 2}}}, {"k1", {{"value", json()}}}}}}),
            "parameters:\n"
            "      value\n"
            "  fx      2\n"
            "  k1      -\n");
}

}  // namespace
}  // namespace helix_arm::test
