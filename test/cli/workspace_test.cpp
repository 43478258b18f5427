#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include <gtest/gtest.h>

#include "command.hpp"
#include "helix_arm/io/scene.hpp"
#include "io/document/number.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

namespace fs = std::filesystem;

Outcome workspace(const std::string& scene, const std::vector<std::string>& more) {
  return runCommand({"workspace", scene, "--format", "json"}, more);
}

struct Ply {
  std::size_t vertices = 0;
  std::vector<std::string> properties;  // all of them float
  std::vector<float> values;            // vertex by vertex
};

// As far as the format goes that is written: binary_little_endian, one element, floats.
Ply readPly(const std::string& path) {
  const std::string bytes = contentOf(path);
  const std::string end = "\nend_header\n";
  const std::size_t header = bytes.find(end);
  if (header == std::string::npos) throw std::runtime_error("no header");
  Ply ply;
  std::istringstream lines(bytes.substr(0, header));
  std::string line;
  std::getline(lines, line);
  EXPECT_EQ(line, "ply");
  std::getline(lines, line);
  EXPECT_EQ(line, "format binary_little_endian 1.0");
  while (std::getline(lines, line)) {
    std::istringstream words(line);
    std::string keyword, type, name;
    words >> keyword >> type >> name;
    if (keyword == "comment") continue;
    if (keyword == "element") {
      EXPECT_EQ(type, "vertex");
      ply.vertices = std::stoul(name);
    } else {
      EXPECT_EQ(keyword, "property");
      EXPECT_EQ(type, "float");
      ply.properties.push_back(name);
    }
  }
  const std::size_t begin = header + end.size();
  EXPECT_EQ(bytes.size() - begin, ply.vertices * ply.properties.size() * sizeof(float));
  ply.values.resize((bytes.size() - begin) / sizeof(float));
  std::memcpy(ply.values.data(), bytes.data() + begin, ply.values.size() * sizeof(float));
  return ply;
}

const std::vector<std::string> kSensitiveProperties{"x",         "y",        "z",
                                                    "per_kpa_m", "per_mm_m", "per_percent_K_m"};

TEST(Workspace, TheCsvHoldsInputsAndTheTipsThatTheyLeadTo) {
  const TemporaryFolder folder;
  for (const std::string name : {"planar_76", "spatial_50", "loaded"}) {
    SCOPED_TRACE(name);
    const std::string path = folder / (name + ".csv");
    const Outcome outcome = workspace(scenePath(name), {"--out", path, "--count", "500"});
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_EQ(contentOf(path).front(), '#');
    const auto rows = csvRows(contentOf(path));
    ASSERT_EQ(rows.size(), 501u);
    const io::Scene scene = io::loadScene(scenePath(name));
    const int n = scene.arm.actuatorCount();
    ASSERT_EQ(rows[0].size(), n + 3u);
    for (int i = 0; i < n; ++i) {
      EXPECT_EQ(rows[0][i], "pressure_" + std::to_string(i + 1) + "_kpa");
    }
    EXPECT_EQ(rows[0][n] + rows[0][n + 1] + rows[0][n + 2], "x_my_mz_m");
    Eigen::Vector3d least = Eigen::Vector3d::Constant(9), most = -least;
    for (std::size_t row = 1; row < rows.size(); ++row) {
      Eigen::VectorXd q(n);
      for (int i = 0; i < n; ++i) q[i] = io::pascals(std::stod(rows[row][i]));
      const Eigen::Vector3d tip(std::stod(rows[row][n]), std::stod(rows[row][n + 1]),
                                std::stod(rows[row][n + 2]));
      EXPECT_LT((scene.model.tip(scene.arm.clamped(q)).tip.translation - tip).norm(), 1e-11);
      least = least.cwiseMin(tip);
      most = most.cwiseMax(tip);
    }
    const nlohmann::json result = outcome.json();
    EXPECT_EQ(result["count"], 500);
    EXPECT_EQ(result["unbalanced"], 0);
    EXPECT_EQ(result["tier"], statics::nameOf(scene.model.choice().setting.tier));
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_NEAR(result["sampled_bounds_m"]["min"][i].get<double>(), least[i], 1e-11);
      EXPECT_GE(result["bounds_m"]["max"][i].get<double>(), most[i] - 1e-11);
    }
  }
}

TEST(Workspace, ThePlyHoldsTheSamePointsAsTheCsv) {
  const TemporaryFolder folder;
  for (const bool sensitive : {false, true}) {
    std::vector<std::string> options{"--count", "20000", "--out", folder / "cloud.ply"};
    if (sensitive) options.emplace_back("--sensitivity");
    ASSERT_EQ(workspace(scenePath("helical_50"), options).exit_code, 0);
    options[3] = folder / "cloud.csv";
    const Outcome outcome = workspace(scenePath("helical_50"), options);
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    const Ply ply = readPly(folder / "cloud.ply");
    const std::size_t columns = sensitive ? 6 : 3;
    EXPECT_EQ(ply.properties, std::vector<std::string>(kSensitiveProperties.begin(),
                                                       kSensitiveProperties.begin() + columns));
    ASSERT_EQ(ply.vertices, 20000u);
    const auto rows = csvRows(contentOf(folder / "cloud.csv"));
    ASSERT_EQ(rows.size(), 20001u);
    ASSERT_EQ(rows[0].size(), 3 + columns);
    std::vector<double> worst(columns, -1);
    for (std::size_t i = 0; i < ply.values.size(); ++i) {
      const double value = std::stod(rows[1 + i / columns][3 + i % columns]);
      ASSERT_NEAR(ply.values[i], value, 1e-6 * std::abs(value) + 1e-9) << i;
      worst[i % columns] = std::max(worst[i % columns], value);
    }
    if (!sensitive) continue;
    const nlohmann::json sensitivity = outcome.json()["sensitivity"];
    for (std::size_t k = 3; k < columns; ++k) {
      const nlohmann::json& told = sensitivity[kSensitiveProperties[k]];
      EXPECT_NEAR(told["max"].get<double>(), worst[k], 1e-5 * worst[k]);
    }
  }
}

// ---- trade: what speed costs in accuracy --------------------------------------------------------

using nlohmann::json;

json rowsOf(const std::string& scene) {
  return resultOf({"trade", scenePath(scene), "--no-files", "--pictures", "0"})["rows"];
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

// Below 1e-11 % errors are rounding, and all the same.
double errorOf(const json& row) { return std::max(row["tip_error_percent"].get<double>(), 1e-11); }

TEST(Trade, MeasuresEveryTierThatTheSceneCanHaveAndNothingBeatsARowOfTheFrontier) {
  const json rows = rowsOf("loaded");
  const auto spatial = settingsOf(rows, "model");
  EXPECT_EQ(spatial.size(), 9u);  // linear, orders 2 to 8, exact
  EXPECT_EQ(spatial.count({"planar", ""}), 0u);
  EXPECT_EQ(spatial.count({"exact", ""}), 1u);
  const auto planar = settingsOf(rowsOf("planar_76"), "model");
  EXPECT_EQ(planar.size(), 10u);
  EXPECT_EQ(planar.count({"planar", ""}), 1u);
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
