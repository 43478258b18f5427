// `helix_arm camera` on rendered pictures whose truth is known.
#include <filesystem>
#include <memory>

#include <gtest/gtest.h>

#include "command.hpp"
#include "helix_arm/io/scene.hpp"
#include "io/document/atomic_file.hpp"
#include "simulation/rig.hpp"
#include "support/temporary_file.hpp"
#include "support/temporary_folder.hpp"
#include "vision/jpeg.hpp"

namespace helix_arm::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

void save(const std::string& path, const cv::Mat& gray) {
  const std::vector<std::uint8_t> jpeg = vision::JpegEncoder(90).encode(gray);
  io::writeFileAtomically(path, std::string(jpeg.begin(), jpeg.end()));
}

// A folder with pictures of a board by the camera of the demo.
class BoardPictures {
 public:
  BoardPictures(const std::vector<std::string>& options, int count) {
    const Outcome outcome = runCommand(
        {"simulate", "demo", "--count", std::to_string(count), "--out", path(), "--format", "json"},
        options);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_EQ(outcome.json()["pictures"], count);
    EXPECT_TRUE(outcome.json()["truth"].is_null());
  }

  std::string path() const { return folder_ / "board"; }
  std::string operator/(const std::string& name) const { return folder_ / name; }

 private:
  TemporaryFolder folder_;
};

const BoardPictures& board() {
  static const BoardPictures pictures({"--board", "tags"}, 18);
  return pictures;
}

// The numbers behind "data: [" of a matrix of a camera_info file.
std::vector<double> matrixOf(const std::string& text, const std::string& name) {
  const std::size_t begin = text.find("data: [", text.find("\n" + name + ":")) + 6;
  return numbersOf(json::parse(text.substr(begin, text.find(']', begin) + 1 - begin)));
}

void expectFocalLength(const json& result) {
  const estimation::Camera truth = io::loadScene(scenePath("demo")).camera->model;
  for (const auto& [name, focal] : {std::pair("fx", truth.fx), {"fy", truth.fy}}) {
    const json& found = result["parameters"][name];
    EXPECT_NEAR(found["value"].get<double>() / focal, 1, 0.005);
    EXPECT_GT(found["standard_error"], 0);
  }
}

TEST(CameraCalibrate, GivesTheCameraThatTookThePictures) {
  const std::string out = board() / "camera.yaml";
  const json result = resultOf(
      {"camera", "calibrate", "--source", board().path(), "--board", "tags", "--out", out});
  expectFocalLength(result);
  const json& parameters = result["parameters"];
  EXPECT_EQ(parameters["fx"]["unit"], "px");
  EXPECT_EQ(parameters["k1"]["unit"], "");
  EXPECT_EQ(parameters.size(), 9u);
  EXPECT_TRUE(result["success"]);
  EXPECT_TRUE(result["scene"].is_null() && result["reason"].is_null());
  EXPECT_EQ(result["size_px"], json({1280, 720}));
  EXPECT_EQ(result["pictures"], 18);
  EXPECT_EQ(result["views"].size(), 18u);
  EXPECT_GT(result["coverage"], 0.7);
  EXPECT_GT(result["reach"], 0.7);
  EXPECT_EQ(result["out"], out);

  const std::string info = contentOf(out);
  EXPECT_TRUE(has(info, "image_width: 1280\nimage_height: 720\ncamera_name: camera\n"));
  EXPECT_TRUE(has(info, "distortion_model: plumb_bob"));
  const auto K = matrixOf(info, "camera_matrix");
  ASSERT_EQ(K.size(), 9u);
  EXPECT_EQ(K[0], parameters["fx"]["value"].get<double>());
  EXPECT_EQ(K[4], parameters["fy"]["value"].get<double>());
  EXPECT_EQ(K[2], parameters["cx"]["value"].get<double>());
  EXPECT_EQ(K[8], 1);
  EXPECT_EQ(matrixOf(info, "distortion_coefficients").size(), 5u);
}

TEST(CameraCalibrate, WritesTheIntrinsicsIntoAScene) {
  const std::string out = board() / "scene.yaml";
  const json result = resultOf({"camera", "calibrate", "--source", board().path(), "--scene",
                                scenePath("demo"), "--out", out, "--set", "tags.size_m=0.03"});
  EXPECT_EQ(result["scene"], "demo");
  const io::Scene before = io::loadScene(scenePath("demo")), after = io::loadScene(out);
  const json& parameters = result["parameters"];
  EXPECT_EQ(after.camera->model.fx, parameters["fx"]["value"].get<double>());
  EXPECT_EQ(after.camera->model.cy, parameters["cy"]["value"].get<double>());
  EXPECT_EQ(after.camera->model.distortion[1], parameters["k2"]["value"].get<double>());
  EXPECT_EQ(after.tags->size, 0.03);
  EXPECT_EQ(after.camera->X_WC.translation, before.camera->X_WC.translation);
}

// The demo rig at rest, seen by a camera that is not where the scene has it.
struct MovedRig {
  io::Scene scene = io::loadScene(scenePath("demo"));
  lie::SE3 X_WC;

  MovedRig() {
    lie::Vector6 off;
    off << 0.03, -0.02, 0.04, 0.03, -0.05, 0.02;
    X_WC = scene.camera->X_WC * lie::SE3::exp(off);
  }
  void photograph(const std::string& path, std::uint32_t seed) const {
    estimation::ArmView view = scene.view();
    view.X_CB = X_WC.inverse() * scene.X_WB;
    simulation::SimulatedCameraConfig config = scene.simulation.camera;
    config.seed = seed;
    simulation::SimulatedCamera camera(view, vision::TagFamily("36h11"),
                                       {{scene.looks[0].separator_radius}}, config);
    // The true arm of the rig, 1 % longer.
    const simulation::TrueArm arm(scene.model, scene.simulation.arm);
    save(path, camera.render(arm.shape(scene.arm.inputAt(0))));
  }
};

TEST(CameraPlace, WritesTheCameraThatItFinds) {
  const TemporaryFolder folder;
  const MovedRig rig;
  for (const std::uint32_t i : {1, 2}) {
    rig.photograph(folder / ("rest_" + std::to_string(i) + ".jpg"), i);
  }
  const std::string out = folder / "placed.yaml";
  const json result =
      resultOf({"camera", "place", scenePath("demo"), "--source", folder.path(), "--out", out});
  EXPECT_EQ(result["pictures"], 2);
  EXPECT_GE(result["tags"].size(), 5u);
  EXPECT_EQ(result["covariance"].size(), 6u);
  const auto position = numbersOf(result["position_m"]);
  const auto error = numbersOf(result["standard_error"]["position_m"]);
  const io::Scene written = io::loadScene(out);
  for (int i = 0; i < 3; ++i) {
    const auto axis = static_cast<std::size_t>(i);
    EXPECT_NEAR(position[axis], rig.X_WC.translation[i], 4 * error[axis]);
    EXPECT_NEAR(written.camera->X_WC.translation[i], position[axis], 1e-12);
  }
  EXPECT_LT((written.camera->X_WC.rotation - rig.X_WC.rotation).norm(), 0.05);
  EXPECT_NEAR(result["moved_m"].get<double>(), 0.054, 0.015);
}

// For --set: the tags of the demo's muscles 2 and 3 in each other's place, those of each counted
// from the tip, or as they are.
std::string tagGroups(bool mirrored, bool reversed) {
  std::string out = "tags.groups=[";
  for (const int muscle : {0, 1, 2}) {
    const int first = 7 * (mirrored ? (3 - muscle) % 3 : muscle);
    out +=
        "{actuator: muscle_" + std::to_string(muscle + 1) + ", position_m: [0, 0, 0.016], ids: [";
    for (int k = 0; k < 7; ++k) {
      out += (k > 0 ? ", " : "") + std::to_string(first + (reversed ? 6 - k : k));
    }
    out += "], s: [0.04, 0.2, 0.36, 0.52, 0.68, 0.84, 1]}" + std::string(muscle < 2 ? ", " : "]");
  }
  return out;
}

TEST(CameraPlace, NamesTheUsualMistakeAndWritesNothing) {
  const TemporaryFolder folder;
  MovedRig().photograph(folder / "rest.jpg", 1);
  const std::string out = folder / "placed.yaml";
  const std::vector<std::string> command{
      "camera", "place", scenePath("demo"), "--source", folder / "rest.jpg",
      "--out",  out,     "--format",        "json",     "--set"};
  const std::vector<std::pair<std::string, std::string>> mistakes{
      {tagGroups(true, false), "tags_mirrored"},
      {tagGroups(false, true), "tag_rows_reversed"},
      {"tags.size_m=0.0355", "tag_size"}};
  for (const auto& [change, cause] : mistakes) {
    const Outcome outcome = runCommand(command, {change});
    EXPECT_EQ(outcome.exit_code, 1) << cause;
    const json result = outcome.json();
    ASSERT_FALSE(result["suspects"].empty()) << result;
    EXPECT_EQ(result["suspects"][0]["cause"], cause);
    EXPECT_TRUE(has(result["reason"], cause)) << result["reason"];
    EXPECT_FALSE(fs::exists(out));
  }
  const Outcome sound = runCommand(command, {tagGroups(false, false)});
  EXPECT_EQ(sound.exit_code, 0);
  EXPECT_TRUE(sound.json()["suspects"].empty());
}

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

  static std::unique_ptr<TemporaryFolder> folder_;
};
std::unique_ptr<TemporaryFolder> Localize::folder_;

TEST_F(Localize, OnePictureNamesTheMistakeThatALongListNames) {
  for (const std::size_t count : {1, 70}) {
    std::vector<std::string> command{"localize", scenePath("demo"), "--set",
                                     tagGroups(true, false)};
    command.insert(command.end(), count, picture(1));
    const Outcome outcome = runCommand(command, {"--format", "json"});
    const json result = outcome.json();
    EXPECT_EQ(result["frames"].size(), count);
    ASSERT_FALSE(result["suspects"].empty()) << count;
    EXPECT_EQ(result["suspects"][0]["cause"], "tags_mirrored") << count;
  }
  EXPECT_TRUE(resultOf({"localize", scenePath("demo"), picture(1)})["suspects"].empty());
}

}  // namespace
}  // namespace helix_arm::test
