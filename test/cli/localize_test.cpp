#include <algorithm>
#include <cmath>
#include <fstream>
#include <memory>

#include <gtest/gtest.h>

#include "command.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

using nlohmann::json;

// Pictures of the demo's arm with their truth, made once.
class Localize : public testing::Test {
 protected:
  static constexpr int kPictures = 3;

  static void SetUpTestSuite() {
    folder_ = std::make_unique<TemporaryFolder>();
    const Outcome outcome = runCommand({"simulate", scenePath("demo"), "--out", *folder_ / "rig",
                                        "--count", std::to_string(kPictures)});
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  }
  static void TearDownTestSuite() { folder_.reset(); }

  static std::string picture(int number) {
    return *folder_ / ("rig/picture_000" + std::to_string(number) + ".jpg");
  }
  static std::string write(const std::string& name, const std::string& content) {
    std::ofstream(*folder_ / name, std::ios::binary) << content;
    return *folder_ / name;
  }

  // What it says of pictures of the demo's arm.
  static json framesOf(std::vector<std::string> what, int exit_code = 0) {
    what.insert(what.begin(), {"localize", scenePath("demo")});
    return resultOf(what, exit_code)["frames"];
  }
  static std::string csvOf(const std::string& path) {
    return runCommand({"localize", scenePath("demo"), path, "--format", "csv"}).out;
  }

  static std::unique_ptr<TemporaryFolder> folder_;
};
std::unique_ptr<TemporaryFolder> Localize::folder_;

TEST_F(Localize, GivesEveryPictureItsTags) {
  const Outcome outcome =
      runCommand({"localize", scenePath("demo"), *folder_ / "rig", "--format", "json"});
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
    EXPECT_EQ(frame["unknown_tags"], json::array());
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

TEST_F(Localize, TheFittedBaseAndBleedAreReported) {
  const json frame = framesOf({picture(1)})[0];
  EXPECT_NEAR(frame["bleed_m"].get<double>(), 0.0002, 0.0001);
  for (const double x : numbersOf(frame["base"]["position_m"])) EXPECT_LT(std::abs(x), 0.005);
  EXPECT_EQ(frame["suspicious"], json::array());
  EXPECT_EQ(frame["unusable_tags"], json::array());
  ASSERT_EQ(frame["tip_covariance"].size(), 3u);
  for (int i = 0; i < 3; ++i) EXPECT_GT(frame["tip_covariance"][i][i].get<double>(), 0);
  const std::string csv = csvOf(picture(1));
  EXPECT_EQ(std::stod(csvColumn(csv, "bleed_m").at(0)), frame["bleed_m"].get<double>());
  EXPECT_EQ(std::stod(csvColumn(csv, "base_x_m").at(0)),
            frame["base"]["position_m"][0].get<double>());
}

// Tags said to be a sixth too large.
TEST_F(Localize, AParameterFarFromItsPriorIsSuspicious) {
  const Outcome outcome = runCommand({"localize", scenePath("demo"), picture(1), "--set",
                                      "tags.size_m=0.036", "--format", "json"});
  const json frame = outcome.json()["frames"][0];
  const json suspicious = frame["suspicious"];
  const auto bleed = std::find_if(suspicious.begin(), suspicious.end(), [](const json& entry) {
    return entry["parameter"] == "bleed_m";
  });
  ASSERT_NE(bleed, suspicious.end()) << frame;
  EXPECT_NEAR((*bleed)["deviations"].get<double>(),
              std::abs(frame["bleed_m"].get<double>()) / 0.0005, 1e-9);
  EXPECT_GT((*bleed)["deviations"].get<double>(), 3);
  EXPECT_NE((*bleed)["remedy"].get<std::string>().find("tags.size_m"), std::string::npos);
}

TEST_F(Localize, ANameThatIsNoUtf8LosesNoResult) {
  const std::string odd = write("odd_\xff.jpg", contentOf(picture(1)));
  EXPECT_EQ(framesOf({odd})[0]["state"], "measured");
}

TEST_F(Localize, CsvHasARowForEveryTag) {
  const json frame = framesOf({picture(1)})[0];
  const auto rows = csvRows(csvOf(picture(1)));
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

TEST_F(Localize, PressuresSayWhereTheSearchBegins) {
  const auto rest = numbersOf(framesOf({picture(1)})[0]["twist"][0]);
  const auto bent = numbersOf(framesOf({picture(1), "--pressure-kpa", "200,20,20"})[0]["twist"][0]);
  for (int j = 0; j < 6; ++j) EXPECT_NEAR(rest[j], bent[j], 1e-5);
  EXPECT_EQ(
      runCommand({"localize", scenePath("demo"), picture(1), "--pressure-kpa", "1,2"}).exit_code,
      2);
}

// No camera, no tags, or a picture of another size: the tags are there all the same.
TEST_F(Localize, WhereTheModelFindsNoShapeTheSearchBeginsWithoutLoad) {
  const std::string rig = *folder_ / "loaded rig";
  ASSERT_EQ(runCommand({"simulate", scenePath("loaded"), "--out", rig, "--count", "1"}).exit_code,
            0);
  std::vector<std::string> command{"localize", scenePath("loaded"), rig + "/picture_0001.jpg",
                                   "--format", "json"};
  const json sound = runCommand(command).json();
  EXPECT_EQ(sound["model_status"], "converged");
  for (const char* const key : {"load.tip.force_n=[0, 0, 1e4]", "tier=loaded", "order=2"}) {
    command.insert(command.end(), {"--set", key});
  }
  const Outcome outcome = runCommand(command);
  ASSERT_EQ(outcome.exit_code, 0) << outcome.out;
  EXPECT_EQ(outcome.json()["model_status"], "not_converged");
  EXPECT_NE(outcome.err.find("the search began at the shape without load"), std::string::npos);
  const std::vector<double> one = numbersOf(outcome.json()["frames"][0]["twist"][0]);
  const std::vector<double> other = numbersOf(sound["frames"][0]["twist"][0]);
  for (int i = 0; i < 6; ++i) {
    const double variance = sound["frames"][0]["covariance"][i][i];
    EXPECT_NEAR(one[i], other[i], std::sqrt(variance)) << i;
  }
}

TEST_F(Localize, WithoutACameraOrTagsTheTagsAreListed) {
  for (const char* name : {"planar_50", "helical_50"}) {
    const json frame = resultOf({"localize", scenePath(name), picture(1)})["frames"][0];
    EXPECT_EQ(frame["state"], "tags_only");
    EXPECT_GE(frame["tags"].size(), 4u);
    EXPECT_EQ(frame["twist"], nullptr);
    EXPECT_EQ(frame["covariance"], nullptr);
    EXPECT_EQ(frame["reason"],
              std::string("scene ") + name + (name[0] == 'p' ? " has no tags" : " has no camera"));
  }
  const json frame = framesOf({picture(1), "--set", "camera.size_px=[640, 480]"}, 1)[0];
  EXPECT_EQ(frame["state"], "wrong_size");
  EXPECT_TRUE(frame["tags"].empty()) << "its header is enough";
  EXPECT_EQ(frame["reason"].get<std::string>().find(
                "the picture has 1280 x 720 pixels, the camera of scene demo 640 x 480"),
            0u);
}

TEST_F(Localize, TagsThatGiveNoTwistAreAFailureWithItsReason) {
  const json frame = framesOf({picture(1), "--set", "vision.min_tags=40"}, 1)[0];
  EXPECT_EQ(frame["state"], "too_few_tags");
  EXPECT_EQ(frame["twist"], nullptr);
  EXPECT_NE(frame["reason"].get<std::string>().find("vision.min_tags is 40"), std::string::npos);
  EXPECT_GE(frame["tags"].size(), 4u);
}

TEST_F(Localize, APictureThatIsBrokenOrShowsNoTagsIsNamedAndTheOthersAreMeasured) {
  const std::string content = contentOf(picture(1));
  const std::string broken = write("broken.jpg", content.substr(0, content.size() / 2));
  const std::string empty = write("empty.jpg", "");
  const std::string blank = write("blank.pgm", "P5 1280 720 255\n" + std::string(1280 * 720, 'x'));
  const json frames = framesOf({broken, picture(1), empty, blank}, 1);
  ASSERT_EQ(frames.size(), 4u);
  EXPECT_EQ(frames[0]["state"], "unreadable");
  EXPECT_EQ(frames[0]["tags"], json::array());
  EXPECT_EQ(frames[0]["reason"].get<std::string>().find(broken + ": a damaged or truncated JPEG"),
            0u);
  EXPECT_EQ(frames[1]["state"], "measured");
  EXPECT_EQ(frames[2]["reason"], empty + ": the file is empty");
  EXPECT_EQ(frames[3]["state"], "no_tags");
  EXPECT_EQ(frames[3]["reason"], "no tag of family 36h11 is in sight");
  EXPECT_EQ(framesOf({blank}, 1).size(), 1u) << "it alone is a failure";
}

}  // namespace
}  // namespace helix_arm::test
