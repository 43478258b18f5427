// `helix_arm camera` on rendered pictures whose truth is known.
#include <filesystem>

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

}  // namespace
}  // namespace helix_arm::test
