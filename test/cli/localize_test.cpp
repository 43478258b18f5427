#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

#include <gtest/gtest.h>
#include <unistd.h>

#include "command.hpp"

namespace helix_arm::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// Pictures of the demo's arm with their truth, made once.
class Localize : public testing::Test {
 protected:
  static constexpr int kPictures = 3;

  static void SetUpTestSuite() {
    std::string name = (fs::temp_directory_path() / "helix_arm_localize_XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    folder_ = name;
    const Outcome outcome = runCommand({"simulate", scenePath("demo"), "--out", name + "/rig",
                                        "--count", std::to_string(kPictures)});
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  }
  static void TearDownTestSuite() { fs::remove_all(folder_); }

  static std::string picture(int number) {
    return (folder_ / "rig" / ("picture_000" + std::to_string(number) + ".jpg")).string();
  }
  static std::string write(const std::string& name, const std::string& content) {
    std::ofstream(folder_ / name, std::ios::binary) << content;
    return (folder_ / name).string();
  }
  static std::string contentOf(const std::string& path) {
    std::ostringstream content;
    content << std::ifstream(path, std::ios::binary).rdbuf();
    return content.str();
  }

  static fs::path folder_;
};
fs::path Localize::folder_;

TEST_F(Localize, GivesEveryPictureItsTags) {
  const Outcome outcome =
      runCommand({"localize", scenePath("demo"), (folder_ / "rig").string(), "--format", "json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(outcome.err, "");
  const json frames = outcome.json()["frames"];
  ASSERT_EQ(frames.size(), static_cast<std::size_t>(kPictures));
  for (int i = 0; i < kPictures; ++i) {
    const json& frame = frames[i];
    EXPECT_EQ(frame["file"], picture(i + 1));
    EXPECT_EQ(frame["state"], "measured");
    EXPECT_EQ(frame["reason"], nullptr);
    EXPECT_GE(frame["tags"].size(), 4u);
    EXPECT_EQ(frame["foreign_tags"], json::array());
    int last = -1;
    for (const json& tag : frame["tags"]) {
      EXPECT_GT(tag["id"], last);
      last = tag["id"];
      ASSERT_EQ(tag["corners_px"].size(), 4u);
      for (const json& corner : tag["corners_px"]) {
        ASSERT_EQ(corner.size(), 2u);
        EXPECT_TRUE(corner[0] >= 0 && corner[0] < 1280 && corner[1] >= 0 && corner[1] < 720);
      }
    }
    EXPECT_LT(frame["rms_px"].get<double>(), 0.3);
  }
}

// truth.csv: capture, pressures, then the twist, as the simulation had it.
TEST_F(Localize, TwistsAreTrueWithinTheirCovariance) {
  const auto truth = csvRows(contentOf((folder_ / "rig" / "truth.csv").string()));
  ASSERT_EQ(truth.size(), static_cast<std::size_t>(1 + kPictures));
  const auto first = std::find(truth[0].begin(), truth[0].end(), "section_1_vx_m");
  ASSERT_NE(first, truth[0].end());
  const long column = first - truth[0].begin();
  for (int i = 0; i < kPictures; ++i) {
    const Outcome outcome =
        runCommand({"localize", scenePath("demo"), picture(i + 1), "--format", "json"});
    const json frame = outcome.json()["frames"][0];
    const std::vector<double> twist = numbersOf(frame["twist"][0]);
    ASSERT_EQ(frame["covariance"].size(), 6u);
    for (int j = 0; j < 6; ++j) {
      const double deviation = std::sqrt(frame["covariance"][j][j].get<double>());
      ASSERT_GT(deviation, 0);
      EXPECT_LT(deviation, j < 3 ? 0.01 : 0.1);
      EXPECT_NEAR(twist[j], std::stod(truth[i + 1][column + j]), 5 * deviation) << i << " " << j;
      EXPECT_NEAR(frame["covariance"][0][j].get<double>(), frame["covariance"][j][0].get<double>(),
                  1e-12);
    }
  }
}

TEST_F(Localize, CsvHasARowForEveryTag) {
  const json frame = runCommand({"localize", scenePath("demo"), picture(1), "--format", "json"})
                         .json()["frames"][0];
  const Outcome outcome =
      runCommand({"localize", scenePath("demo"), picture(1), "--format", "csv"});
  ASSERT_EQ(outcome.exit_code, 0);
  const auto rows = csvRows(outcome.out);
  ASSERT_EQ(rows.size(), 1 + frame["tags"].size());
  EXPECT_EQ(rows[0][2], "tag");
  EXPECT_EQ(rows[0][3], "corner_1_x_px");
  for (std::size_t i = 0; i < frame["tags"].size(); ++i) {
    EXPECT_EQ(rows[i + 1][0], picture(1));
    EXPECT_EQ(rows[i + 1][2], std::to_string(frame["tags"][i]["id"].get<int>()));
    EXPECT_EQ(std::stod(rows[i + 1][3]), frame["tags"][i]["corners_px"][0][0].get<double>());
    EXPECT_EQ(std::stod(rows[i + 1].back()), frame["twist"][0][5].get<double>());
  }
}

TEST_F(Localize, TextNamesTheStateAndTheTags) {
  const Outcome outcome = runCommand({"localize", scenePath("demo"), picture(1)});
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_NE(outcome.out.find(picture(1) + ": measured, "), std::string::npos) << outcome.out;
}

TEST_F(Localize, PressuresSayWhereTheSearchBegins) {
  const auto twistAt = [](const std::vector<std::string>& more) {
    std::vector<std::string> arguments{"localize", scenePath("demo"), picture(1), "--format",
                                       "json"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const Outcome outcome = runCommand(arguments);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return numbersOf(outcome.json()["frames"][0]["twist"][0]);
  };
  const auto rest = twistAt({}), bent = twistAt({"--pressure-kpa", "200,20,20"});
  for (int j = 0; j < 6; ++j) EXPECT_NEAR(rest[j], bent[j], 1e-5);
  EXPECT_EQ(
      runCommand({"localize", scenePath("demo"), picture(1), "--pressure-kpa", "1,2"}).exit_code,
      2);
}

// No camera, no tags, or a picture of another size: the tags are there all the same.
TEST_F(Localize, WithoutACameraOrTagsTheTagsAreListed) {
  for (const char* name : {"planar_50", "helical_50"}) {
    const Outcome outcome =
        runCommand({"localize", scenePath(name), picture(1), "--format", "json"});
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    const json frame = outcome.json()["frames"][0];
    EXPECT_EQ(frame["state"], "tags_only");
    EXPECT_GE(frame["tags"].size(), 4u);
    EXPECT_EQ(frame["twist"], nullptr);
    EXPECT_EQ(frame["covariance"], nullptr);
    EXPECT_EQ(frame["reason"],
              std::string("scene ") + name + (name[0] == 'p' ? " has no tags" : " has no camera"));
  }
  const Outcome outcome = runCommand({"localize", scenePath("demo"), picture(1), "--format", "json",
                                      "--set", "camera.size_px=[640, 480]"});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(outcome.json()["frames"][0]["reason"],
            "the picture has 1280 x 720 pixels, the camera of scene demo 640 x 480");
}

TEST_F(Localize, TagsThatGiveNoTwistAreAFailureWithItsReason) {
  const Outcome outcome = runCommand({"localize", scenePath("demo"), picture(1), "--format", "json",
                                      "--set", "vision.min_tags=40"});
  EXPECT_EQ(outcome.exit_code, 1);
  const json frame = outcome.json()["frames"][0];
  EXPECT_EQ(frame["state"], "too_few_tags");
  EXPECT_EQ(frame["twist"], nullptr);
  EXPECT_NE(frame["reason"].get<std::string>().find("at least 40 are needed"), std::string::npos);
  EXPECT_GE(frame["tags"].size(), 4u);
}

TEST_F(Localize, ABrokenPictureIsNamedAndTheOthersAreMeasured) {
  const std::string content = contentOf(picture(1));
  const std::string broken = write("broken.jpg", content.substr(0, content.size() / 2));
  const std::string empty = write("empty.jpg", "");
  const Outcome outcome =
      runCommand({"localize", scenePath("demo"), broken, picture(1), empty, "--format", "json"});
  EXPECT_EQ(outcome.exit_code, 1);
  const json frames = outcome.json()["frames"];
  ASSERT_EQ(frames.size(), 3u);
  EXPECT_EQ(frames[0]["state"], "unreadable");
  EXPECT_EQ(frames[0]["tags"], json::array());
  EXPECT_EQ(frames[0]["reason"].get<std::string>().find(broken + ": a broken or truncated JPEG"),
            0u);
  EXPECT_EQ(frames[1]["state"], "measured");
  EXPECT_EQ(frames[2]["reason"], empty + ": the file is empty");
}

TEST_F(Localize, APictureWithoutTagsIsAFailure) {
  const std::string blank = write("blank.pgm", "P5 1280 720 255\n" + std::string(1280 * 720, 'x'));
  const Outcome outcome = runCommand({"localize", scenePath("demo"), blank, "--format", "json"});
  EXPECT_EQ(outcome.exit_code, 1);
  const json frame = outcome.json()["frames"][0];
  EXPECT_EQ(frame["state"], "no_tags");
  EXPECT_EQ(frame["reason"], "no tag of family 36h11 is in sight");
}

TEST_F(Localize, WhatIsNoPictureIsTheCallersError) {
  for (const std::string& path : {write("notes.txt", "x"), (folder_ / "nothing.jpg").string()}) {
    const Outcome outcome = runCommand({"localize", scenePath("demo"), path});
    EXPECT_EQ(outcome.exit_code, 2);
    EXPECT_EQ(outcome.out, "");
    EXPECT_NE(outcome.err.find(path + " is n"), std::string::npos) << outcome.err;
  }
}

}  // namespace
}  // namespace helix_arm::test
