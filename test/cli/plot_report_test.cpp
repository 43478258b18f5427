// scripts/plot_report, which draws what `helix_arm calibrate --format json` prints.

#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sys/wait.h>

#include "nlohmann/json.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

using nlohmann::json;

constexpr int kWidth = 1280;

json capture(int number, double kpa, const std::string& kind) {
  const double model = std::tanh(kpa / 250), measured = model + 0.03 * std::sin(5.0 * number);
  const bool curvature = kind == "curvature";
  return {{"capture", number},
          {"pressure_pa", {1e3 * kpa, 0.0}},
          {"kind", kind},
          {"measured_rad", curvature ? json(measured) : json(nullptr)},
          {"model_rad", curvature ? json(model) : json(nullptr)},
          {"held_out_rad", curvature && number % 2 == 0 ? json(model) : json(nullptr)},
          {"rms", std::abs(measured - model)},
          {"outlier_tags", number == 3 && !curvature ? json({5, 7}) : json::array()},
          {"outlier", number == 4},
          {"gain", 0.2}};
}

json arm(const std::string& name, const std::string& kind, int captures) {
  json out{{"name", name}, {"captures", json::array()}};
  for (int i = 1; i <= captures; ++i) out["captures"].push_back(capture(i, 30.0 * i, kind));
  return out;
}

json heldOut(int groups) {
  json out{{"error", 0.05}, {"in_sample", 0.04}, {"groups", json::array()}};
  for (int i = 0; i < groups; ++i) {
    out["groups"].push_back({{"label", std::to_string(30 * i) + ", 0 kPa"}, {"error", 0.01 * i}});
  }
  return out;
}

// One of everything.
json report() {
  json out{{"scene", "spatial_50 at $5"},
           {"arms", {arm("planar_76", "curvature", 11), arm("wide", "curvature", 9)}},
           {"held_out_error", 0.05},
           {"error_unit", "rad"},
           {"held_out", {{"by_pressure", heldOut(11)}, {"by_arm", heldOut(2)}}}};
  json curve{{"name", "muscle"}, {"samples", json::array()}, {"curve", json::array()}};
  curve["rms_m"] = 6.5e-4;
  for (int i = 0; i <= 10; ++i) {
    const json point{{"pressure_pa", 4e4 * i}, {"length_m", 0.43 - 0.1 * std::tanh(0.2 * i)}};
    curve["samples"].push_back(point);
    curve["curve"].push_back(point);
  }
  out["contractions"] = {curve};
  out["parameters"]["K_kappa"] = {{"value", 1.2718e-4},
                                  {"standard_error", 3e-6},
                                  {"initial", 1.38e-4},
                                  {"identifiable", true},
                                  {"unit", "m^2"}};
  out["parameters"]["K_gamma"] = {{"value", 10.0},
                                  {"standard_error", nullptr},
                                  {"initial", 10.0},
                                  {"identifiable", false},
                                  {"unit", ""}};
  return out;
}

class PlotReport : public testing::Test {
 protected:
  // Writes a report, has it drawn, keeps what the script said.
  int draw(const std::string& text) {
    std::ofstream(source_) << text;
    return run(source_, target_);
  }
  int draw(const json& document) { return draw(document.dump()); }
  int run(const std::string& source, const std::string& target) {
    const std::string command = "'" HELIX_ARM_SOURCE_DIR "/scripts/plot_report' '" + source +
                                "' '" + target + "' 2>'" + errors_ + "'";
    const int status = std::system(command.c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  std::string errors() const {
    std::ifstream file(errors_);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  cv::Mat picture() const { return cv::imread(target_, cv::IMREAD_GRAYSCALE); }

  void expectRefused(const json& document, const std::string& message) {
    EXPECT_EQ(draw(document), 2);
    EXPECT_NE(errors().find(message), std::string::npos) << errors();
    EXPECT_EQ(errors().find("Traceback"), std::string::npos) << errors();
    EXPECT_FALSE(std::filesystem::exists(target_));
  }

  TemporaryFolder folder_;
  const std::string source_ = folder_ / "report.json", target_ = folder_ / "report.png";
  const std::string errors_ = folder_ / "errors.txt";
};

// Share of the pixels of a part of the picture that are not white.
double inked(const cv::Mat& picture) {
  return cv::countNonZero(picture < 250) / static_cast<double>(picture.total());
}

TEST_F(PlotReport, ShowsAllThatTheReportHas) {
  ASSERT_EQ(draw(report()), 0) << errors();
  EXPECT_EQ(errors(), "");
  const cv::Mat all = picture();
  ASSERT_EQ(all.cols, kWidth);
  // Contraction and two arms, residuals, two kinds of groups: three rows; and the table.
  EXPECT_GT(all.rows, 3 * 400);
  EXPECT_LT(all.rows, 4 * 400);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 2; ++column) {
      const cv::Rect panel(column * kWidth / 2, 50 + 400 * row, kWidth / 2, 400);
      EXPECT_GT(inked(all(panel)), 0.02) << row << " " << column;
    }
  }
  EXPECT_GT(inked(all.rowRange(all.rows - 60, all.rows)), 0.01);

  ASSERT_EQ(draw(json{{"contractions", report()["contractions"]}}), 0) << errors();
  EXPECT_EQ(picture().cols, kWidth);
  EXPECT_LT(picture().rows, 500);
  EXPECT_GT(inked(picture()), 0.02);
}

TEST_F(PlotReport, ManyCapturesAndGroupsAndParametersHaveTheirPlace) {
  json many = report();
  many["arms"] = {arm("helical_50", "tag_poses", 300)};
  many["arms"][0]["captures"][10]["rms"] = 40.0;
  many["arms"][0]["captures"][20].erase("rms");
  many["error_unit"] = "m";
  many["held_out"] = {{"by_pressure", heldOut(300)}, {"by_arm", nullptr}};
  for (int i = 0; i < 100; ++i) {
    many["parameters"]["tag_" + std::to_string(i) + "_along"] = many["parameters"]["K_kappa"];
  }
  ASSERT_EQ(draw(many), 0) << errors();
  EXPECT_EQ(errors(), "");
  EXPECT_EQ(picture().cols, kWidth);
  EXPECT_LT(picture().rows, 2400);
}

// Points in a box as helix_arm workspace writes them, of which some may be missing.
void writeCloud(const std::string& path, float width, int missing = 0) {
  constexpr int kCount = 4000;
  std::ofstream file(path, std::ios::binary);
  file << "ply\nformat binary_little_endian 1.0\ncomment of $50\nelement vertex " << kCount
       << "\nproperty float x\nproperty float y\nproperty float z\nproperty float per_kpa_m\n"
          "end_header\n";
  std::mt19937 generator(1);
  std::uniform_real_distribution<float> part(0, 1);
  for (int i = missing; i < kCount; ++i) {
    const float point[] = {0.1F + 0.3F * part(generator), width * part(generator),
                           0.2F * part(generator), 1e-4F * part(generator)};
    file.write(reinterpret_cast<const char*>(point), sizeof point);
  }
}

TEST_F(PlotReport, MapsStandInARowAQuantity) {
  const json maps{
      {"scene", "helical $50"}, {"tier", "linear"}, {"reach_m", 0.41}, {"cloud", "cloud.ply"}};
  writeCloud(folder_ / "cloud.ply", 0.2F);
  ASSERT_EQ(draw(maps), 0) << errors();
  EXPECT_EQ(errors(), "");
  const cv::Mat all = picture();
  ASSERT_EQ(all.cols, kWidth);
  for (int row = 0; row < 2; ++row) {
    for (int column = 0; column < 3; ++column) {
      const cv::Rect panel(column * kWidth / 3, 50 + row * (all.rows - 50) / 2, kWidth / 3,
                           (all.rows - 50) / 2);
      EXPECT_GT(inked(all(panel)), 0.1) << row << " " << column;
    }
  }
  writeCloud(folder_ / "cloud.ply", 0);
  ASSERT_EQ(draw(maps), 0) << errors();
  EXPECT_LT(picture().rows, all.rows) << "of one plane, side by side";

  std::filesystem::remove(target_);
  writeCloud(folder_ / "cloud.ply", 0.2F, 1);
  expectRefused(maps, "expected a PLY file of points");
  std::ofstream(folder_ / "cloud.ply") << "ply\nproperty";
  expectRefused(maps, "expected a PLY file of points");
  std::filesystem::remove(folder_ / "cloud.ply");
  expectRefused(maps, "cannot be read");
}

// A run around a circle in the y-z plane, closed beside open.
json circleRuns() {
  json wanted = json::array(), runs = json::array();
  for (const double radius : {30.0, 20.0}) {
    json run{{"name", radius > 20 ? "open loop: RMS 10 mm" : "closed loop: RMS 0.4 mm"}};
    for (int i = 0; i < 200; ++i) {
      const double angle = 0.0314 * i;
      const auto place = [angle](double r) {
        return json{0.36, 1e-3 * r * std::cos(angle), 1e-3 * r * std::sin(angle)};
      };
      run["time_s"].push_back(0.01 * i);
      run["tip_m"].push_back(place(radius + 0.4));
      run["error_m"].push_back(1e-3 * (radius - 19.6));
      if (radius > 20) wanted.push_back(place(20));
    }
    runs.push_back(run);
  }
  return {{"scene", "demo $5"},
          {"follow",
           {{"wanted_m", wanted}, {"along_path", true}, {"blind_s", {0.5, 1}}, {"runs", runs}}}};
}

TEST_F(PlotReport, RunsShowTheTipAndItsErrorOverTime) {
  const json path = circleRuns();
  ASSERT_EQ(draw(path), 0) << errors();
  EXPECT_EQ(errors(), "");
  const cv::Mat all = picture();
  ASSERT_EQ(all.cols, kWidth);
  for (int column = 0; column < 2; ++column) {
    EXPECT_GT(inked(all.colRange(column * kWidth / 2, (column + 1) * kWidth / 2)), 0.02) << column;
  }
  json tips = path;
  tips["follow"]["along_path"] = false;
  tips["follow"]["blind_s"] = nullptr;
  tips["follow"]["runs"].erase(0);
  ASSERT_EQ(draw(tips), 0) << errors();

  std::filesystem::remove(target_);
  json wrong = path;
  wrong["follow"]["runs"][1]["error_m"].push_back(1);
  expectRefused(wrong, "follow.runs[1] has 200 times, 200 tips and 201 errors; expected the same");
  wrong = path;
  wrong["follow"]["wanted_m"][3] = {1, 2};
  expectRefused(wrong, "follow.wanted_m[3] is [1, 2]; expected x, y, z");
  wrong = path;
  wrong["follow"]["runs"] = json::array();
  expectRefused(wrong, "follow has 200 wanted tips and 0 runs; expected some");
}

TEST_F(PlotReport, RecordedRunsShowTheirPressuresToo) {
  json record = circleRuns();
  json& follow = record["follow"];
  follow.erase("blind_s");
  follow["runs"][0]["kind"] = "model";
  follow["runs"][1]["kind"] = "measured";
  json& pressures = follow["pressures"];
  pressures["names"] = {"muscle_1", "muscle_2"};
  for (int i = 0; i < 50; ++i) {
    pressures["time_s"].push_back(0.04 * i);
    pressures["command_pa"].push_back({1e5 + 1e3 * i, 5e4});
    pressures["measured_pa"].push_back({1e5 + 9e2 * i, 5e4});
  }
  ASSERT_EQ(draw(record), 0) << errors();
  EXPECT_EQ(errors(), "");
  const cv::Mat all = picture();
  ASSERT_EQ(all.cols, kWidth);
  EXPECT_GT(inked(all.rowRange(2 * all.rows / 3, all.rows)), 0.01);
  std::string begin(256, ' ');
  std::ifstream(target_, std::ios::binary).read(begin.data(), 256);
  EXPECT_NE(begin.find("helix_arm plot_report"), std::string::npos) << "file_access looks for it";

  std::filesystem::remove(target_);
  pressures["measured_pa"][7] = {1e5};
  expectRefused(record,
                "follow.pressures.measured_pa is malformed; expected one pressure per name in each "
                "of 50 rows");
}

TEST_F(PlotReport, AMissingReportIsNamed) {
  EXPECT_EQ(run(folder_ / "none.json", target_), 2);
  EXPECT_NE(errors().find("none.json cannot be read: No such file"), std::string::npos) << errors();
  EXPECT_EQ(run(folder_.path(), target_), 2);
  EXPECT_NE(errors().find("cannot be read: Is a directory"), std::string::npos) << errors();
  EXPECT_EQ(run("/dev/zero", target_), 2);
  EXPECT_NE(errors().find("/dev/zero is not a regular file"), std::string::npos) << errors();
}

TEST_F(PlotReport, AMalformedReportIsNamedWithItsCulprit) {
  EXPECT_EQ(draw(std::string("{\"arms\": [")), 2);
  EXPECT_NE(errors().find("report.json is not valid JSON: "), std::string::npos) << errors();
  expectRefused(json::array({1}), "is not a JSON object");
  expectRefused(json::object(), "has nothing to plot; expected rows, cloud, arms, contractions");
  json wrong = report();
  wrong["arms"][1]["captures"][2]["rms"] = "small";
  expectRefused(wrong, R"(arms[1].captures[2].rms is "small"; expected a finite number)");
  wrong = report();
  wrong["arms"][0]["captures"][0]["kind"] = "guess";
  expectRefused(wrong, R"(arms[0].captures[0].kind is "guess"; expected curvature or tag_poses)");
  wrong = report();
  wrong["arms"][0]["captures"][0]["pressure_pa"] = {1.0};
  expectRefused(wrong, "arms[0].captures have [1, 2] pressures; expected the same number in each");
  wrong = report();
  wrong["arms"][0]["captures"] = json::object();
  expectRefused(wrong, "arms[0].captures is {}; expected an array");
  wrong = report();
  wrong["contractions"][0].erase("rms_m");
  expectRefused(wrong, "contractions[0] has no rms_m");
  wrong = report();
  wrong["parameters"]["K_kappa"]["identifiable"] = 1;
  expectRefused(wrong, "parameters.K_kappa.identifiable is 1; expected true or false");
  EXPECT_EQ(draw(std::string(R"({"held_out_error": NaN})")), 2);
  EXPECT_NE(errors().find("held_out_error is NaN; expected a finite number"), std::string::npos)
      << errors();
}

TEST_F(PlotReport, APictureThatCannotBeWrittenLeavesNothing) {
  std::ofstream(source_) << report();
  EXPECT_EQ(run(source_, folder_ / "none/report.png"), 2);
  EXPECT_NE(errors().find("none/report.png cannot be written: No such file"), std::string::npos)
      << errors();
  EXPECT_EQ(run(source_, folder_.path()), 2);
  EXPECT_NE(errors().find("cannot be written: "), std::string::npos) << errors();
  for (const auto& entry : std::filesystem::directory_iterator(folder_.path())) {
    EXPECT_EQ(entry.path().extension() == ".part", false) << entry.path();
  }
}

}  // namespace
}  // namespace helix_arm::test
