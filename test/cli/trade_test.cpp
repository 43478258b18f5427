// helix_arm trade: what speed costs in accuracy.

#include <algorithm>
#include <filesystem>
#include <map>
#include <set>

#include <gtest/gtest.h>

#include "command.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

json rowsOf(const std::string& scene, std::vector<std::string> more = {}) {
  std::vector<std::string> arguments = {"trade", scenePath(scene), "--no-files", "--pictures",
                                        "0",     "--format",       "json"};
  arguments.insert(arguments.end(), more.begin(), more.end());
  const Outcome outcome = runCommand(arguments);
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  return outcome.json()["rows"];
}

// (tier, setting) of the rows of a part.
std::set<std::pair<std::string, std::string>> settingsOf(const json& rows,
                                                         const std::string& part) {
  std::set<std::pair<std::string, std::string>> out;
  for (const json& row : rows) {
    if (row["part"] == part)
      out.emplace(row["tier"].get<std::string>(), row["setting"].get<std::string>());
  }
  return out;
}

const json& rowOf(const json& rows, const std::string& tier, const std::string& setting) {
  return *std::find_if(rows.begin(), rows.end(), [&](const json& row) {
    return row["tier"] == tier && row["setting"] == setting;
  });
}

// Below 1e-11 % errors are rounding, and all the same.
double errorOf(const json& row) { return std::max(row["tip_error_percent"].get<double>(), 1e-11); }

TEST(Trade, MeasuresEveryTierThatTheSceneCanHave) {
  const auto spatial = settingsOf(rowsOf("loaded"), "model");
  EXPECT_EQ(spatial.size(), 9u);  // linear, orders 2 to 8, exact
  EXPECT_EQ(spatial.count({"planar", ""}), 0u);
  EXPECT_EQ(spatial.count({"exact", ""}), 1u);
  const auto planar = settingsOf(rowsOf("planar_76"), "model");
  EXPECT_EQ(planar.size(), 10u);
  EXPECT_EQ(planar.count({"planar", ""}), 1u);
}

TEST(Trade, NothingBeatsARowOfTheFrontier) {
  const json rows = rowsOf("loaded");
  std::map<std::string, int> on_frontier;
  for (const json& row : rows) {
    ASSERT_GT(row["time_ns"].get<double>(), 0);
    ASSERT_TRUE(row["tip_error_percent"].is_number()) << row;
    const bool beaten = std::any_of(rows.begin(), rows.end(), [&](const json& other) {
      if (other["part"] != row["part"]) return false;
      const double faster = row["time_ns"].get<double>() - other["time_ns"].get<double>();
      const double better = errorOf(row) - errorOf(other);
      return faster >= 0 && better >= 0 && (faster > 0 || better > 0);
    });
    EXPECT_NE(beaten, row["on_frontier"].get<bool>()) << row;
    if (row["on_frontier"]) ++on_frontier[row["part"]];
  }
  for (const char* const part : {"model", "curve", "markers"}) EXPECT_GE(on_frontier[part], 1);
}

TEST(Trade, MeasuresSightOnRenderedPictures) {
  const json rows =
      resultOf({"trade", scenePath("loaded"), "--no-files", "--pictures", "6"})["rows"];
  EXPECT_EQ(settingsOf(rows, "sight").size(), 15u);
  EXPECT_GE(settingsOf(rows, "fit").size(), 5u);
  const double error = rowOf(rows, "whole picture", "quad_decimate 1")["tip_error_percent"];
  EXPECT_LT(error, 1.0);
}

TEST(Trade, SaysWhatItCouldNotMeasure) {
  const Outcome outcome =
      runCommand({"trade", scenePath("helical_50"), "--no-files", "--format", "json"});
  ASSERT_EQ(outcome.exit_code, 0);
  EXPECT_NE(outcome.json()["notes"].dump().find("no camera"), std::string::npos);
  EXPECT_TRUE(settingsOf(outcome.json()["rows"], "sight").empty());
}

TEST(Trade, ATierWithoutShapesLeavesSightOutAndSaysSo) {
  const json result =
      resultOf({"trade", scenePath("loaded"), "--set", "load.tip.force_n=[0, 0, 1e4]", "--set",
                "tier=loaded", "--set", "order=2", "--no-files", "--pictures", "2"});
  EXPECT_NE(result["notes"].dump().find("finds no shape to start from"), std::string::npos);
  EXPECT_TRUE(settingsOf(result["rows"], "sight").empty());
  EXPECT_EQ(settingsOf(result["rows"], "model").count({"exact", ""}), 1u);
}

TEST(Trade, WritesTableReportAndPicture) {
  const TemporaryFolder folder;
  const fs::path out = folder / "trade of it";
  const Outcome outcome = runCommand(
      {"trade", scenePath("loaded"), "--pictures", "0", "--out", out.string(), "--format", "csv"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(contentOf((out / "trade.csv").string()), outcome.out);
  const auto rows = csvRows(outcome.out);
  EXPECT_EQ(rows.front(), (std::vector<std::string>{"part", "tier", "setting", "time_ns",
                                                    "tip_error_percent", "on_frontier"}));
  EXPECT_EQ(json::parse(contentOf((out / "trade.json").string()))["rows"].size() + 1, rows.size());
  EXPECT_EQ(contentOf((out / "trade.png").string()).substr(1, 3), "PNG");
}

}  // namespace
}  // namespace helix_arm::test
