// Scenes that take another's place while the nodes run; and parts of nodes, each on its own.
#include <future>

#include <ros/service.h>
#include <sys/stat.h>

#include "ros_bridge/common/reload_server.hpp"
#include "ros_bridge/vision/observations.hpp"
#include "support/temporary_file.hpp"
#include "support/temporary_folder.hpp"
#include "support/vision_rig.hpp"

namespace helix_arm::test {
namespace {

constexpr char kDemo[] = HELIX_ARM_SOURCE_DIR "/config/scenes/demo.yaml";
constexpr char kPressureCommand[] = "pressure_command";
constexpr char kVision[] = "vision";
constexpr char kMonitor[] = "monitor";
constexpr const char* kNodes[] = {kPressureCommand, kVision, kMonitor};

// The demo scene with some keys set otherwise.
std::string demoWith(const std::vector<io::Override>& overrides) {
  return io::sceneText(kDemo, overrides);
}

Reload::Response reload(const std::string& node, const std::string& scene) {
  Reload call;
  call.request.scene = scene;
  const std::string service = node + "/reload";
  EXPECT_TRUE(ros::service::waitForService(service, ros::Duration(20)));
  EXPECT_TRUE(ros::service::call(service, call)) << service;
  return call.response;
}

class Reloading : public ::testing::Test {
 protected:
  void SetUp() override {
    rig_.keepOn();
    ASSERT_TRUE(rig_.connect());
  }
  // The nodes of all tests go on with the demo's scene.
  void TearDown() override {
    const TargetStatus answer = rig_.sendPressures({0, 0, 0});
    ASSERT_EQ(answer.outcome, TargetStatus::REACHED) << answer.message;
    for (const char* node : kNodes) {
      const Reload::Response response = reload(node, "demo");
      EXPECT_TRUE(response.success) << response.message;
    }
  }

  // As fast as the scene's slew lets it.
  bool comesTo(const std::vector<double>& pressure) {
    return nullptr !=
           rig_.command.next([&](const PressureArray& c) { return c.pressure == pressure; });
  }

  Rig rig_;
};

// Whether a model is the scene's at what was measured at the same time.
bool isModelOf(const io::Scene& scene, const Rig& rig, const ArmShape& model) {
  const auto measured = VisionListener::of(rig.measured, model.header.stamp);
  if (!measured) return false;
  const model::Twists expected = scene.arm.twists(scene.arm.clamped(vectorOf(measured->pressure)));
  return (vectorOf(model.twist) - Eigen::Map<const Eigen::VectorXd>(expected.data(), 6)).norm() <
         1e-9;
}

TEST_F(Reloading, AnotherStiffnessIsAnotherModelAtTheSameCommand) {
  ASSERT_EQ(rig_.sendPressures({3e5, 0, 0}).outcome, TargetStatus::REACHED);
  const io::Scene demo = shippedScene("demo");
  const TemporaryFile file(demoWith({{"arm.stiffness.K_kappa_m2", "2e-4"}}), ".yaml");
  const io::Scene stiffer = io::loadScene(file.path());
  ASSERT_TRUE(rig_.model.next([&](const ArmShape& m) { return isModelOf(demo, rig_, m); }));
  const Reload::Response response = reload(kPressureCommand, file.path());
  EXPECT_TRUE(response.success) << response.message;
  EXPECT_TRUE(rig_.model.next([&](const ArmShape& m) { return isModelOf(stiffer, rig_, m); }));
  EXPECT_TRUE(comesTo({3e5, 0, 0}));
  // Without a path, the file that the node has now: it may have changed.
  std::ofstream(file.path()) << demoWith({});
  EXPECT_TRUE(reload(kPressureCommand, "").success);
  EXPECT_TRUE(rig_.model.next([&](const ArmShape& m) { return isModelOf(demo, rig_, m); }));
}

// The effective pressure of muscles with play that come down is above their pressure.
TEST_F(Reloading, ATipTargetGoesWhereTheNewResponseIsEffective) {
  const TemporaryFile file(
      demoWith({{"contractions.fig3_muscle.response", "{play_kpa: [20], play_weight: [0.6]}"}}),
      ".yaml");
  const io::Scene scene = io::loadScene(file.path());
  ASSERT_TRUE(reload(kPressureCommand, file.path()).success);
  ASSERT_EQ(rig_.sendPressures({3e5, 0, 0}).outcome, TargetStatus::REACHED);
  ASSERT_TRUE(rig_.measured.next([](const PressureArray& m) { return m.pressure[0] > 2.9e5; }));
  rig_.fallSilent();
  const Eigen::Vector3d wanted = scene.model.tip(Eigen::Vector3d(2e5, 2e4, 2e4)).tip.translation;
  TipTarget target;
  target.mode = TipTarget::POSITION;
  target.pose.position = ros_bridge::toPointMsg(wanted);
  EXPECT_TRUE(waitFor([&] {
    if (rig_.send(target).outcome != TargetStatus::REACHED) return false;
    return (ros_bridge::fromMsg(rig_.model.last().tip).translation - wanted).norm() < 1e-3;
  }));
  const std::vector<double> command = rig_.command.last().pressure;
  EXPECT_LT(command[0], 2e5 - 0.5 * 0.6 * 2e4) << "less than its effective pressure";
}

TEST_F(Reloading, AFaultyFileChangesNothing) {
  const io::Scene demo = shippedScene("demo");
  const TemporaryFile faulty(demoWith({}) + "\nnonsense: 1\n", ".yaml"), broken("arm: [", ".yaml");
  for (const char* node : kNodes) {
    for (const std::string& path : {faulty.path(), broken.path(), std::string("/no/such.yaml"),
                                    std::string("no_such_scene"), std::string("../demo.yaml")}) {
      const Reload::Response response = reload(node, path);
      EXPECT_FALSE(response.success) << node << " " << path;
      EXPECT_FALSE(response.message.empty()) << node << " " << path;
    }
    const Reload::Response response = reload(node, faulty.path());
    EXPECT_NE(response.message.find("nonsense"), std::string::npos) << response.message;
  }
  EXPECT_TRUE(rig_.model.next([&](const ArmShape& m) { return isModelOf(demo, rig_, m); }));
}

TEST_F(Reloading, AnotherRigIsRefused) {
  const TemporaryFile brisk(
      io::sceneText(HELIX_ARM_SOURCE_DIR "/test/ros_bridge/scenes/brisk.yaml"), ".yaml");
  for (const char* node : kNodes) {
    for (const std::string& scene : {std::string("planar_76"), brisk.path()}) {
      const Reload::Response response = reload(node, scene);
      EXPECT_FALSE(response.success) << node << " " << scene;
    }
  }
  const Reload::Response response = reload(kPressureCommand, "planar_76");
  EXPECT_NE(response.message.find("not of the running rig"), std::string::npos) << response.message;
}

// Which paths are taken is a law of FileAccess; here every node goes by it at once, and no message
// contains any of a file.
TEST_F(Reloading, ScenesComeFromTheirFolderAlone) {
  const TemporaryFolder folder;
  const std::string fifo = folder / "fifo.yaml";
  ASSERT_EQ(mkfifo(fifo.c_str(), 0600), 0);
  std::filesystem::create_symlink("/etc", folder / "etc");
  for (const char* node : kNodes) {
    for (const auto& [path, words] :
         {std::pair(fifo, "regular file"),
          {folder / "etc/passwd", "file below"},
          {HELIX_ARM_SOURCE_DIR "/test/ros_bridge/scenes/brisk.yaml", "file below"}}) {
      const Reload::Response response = reload(node, path);
      EXPECT_FALSE(response.success) << node << " " << path;
      EXPECT_TRUE(has(response.message, words));
      EXPECT_EQ(response.message.find("root:"), std::string::npos) << response.message;
    }
  }
}

TEST_F(Reloading, VisionLooksForTheNewScenesTagsFromTheNextPictureOn) {
  CameraStandIn camera("");
  ASSERT_TRUE(camera.connect());
  const cv::Mat picture = camera.picture(camera.twists({1e5, 0, 0}));
  const auto tipAfterShowing = [&]() -> Eigen::Vector3d {
    const ros::Time stamp = camera.stamp();
    camera.show(picture, stamp);
    const auto measured = VisionListener::of(camera.measured, stamp);
    if (!measured) return Eigen::Vector3d::Constant(std::nan(""));
    return ros_bridge::fromMsg(measured->tip).translation;
  };
  const Eigen::Vector3d before = tipAfterShowing();
  ASSERT_TRUE(before.allFinite());
  // Seen from 5 cm farther away, the same picture is of an arm that is 5 cm farther away.
  const io::Scene demo = shippedScene("demo");
  const Eigen::Vector3d away =
      demo.camera->X_WC.translation - 0.05 * demo.camera->X_WC.rotation.col(2);
  std::ostringstream position;
  position.precision(17);
  position << "[" << away.x() << ", " << away.y() << ", " << away.z() << "]";
  const TemporaryFile file(demoWith({{"camera.position_m", position.str()},
                                     {"vision.base_prior.translation_m", "0.0001"},
                                     {"vision.base_prior.rotation_deg", "0.01"}}),
                           ".yaml");
  const Reload::Response response = reload(kVision, file.path());
  ASSERT_TRUE(response.success) << response.message;
  const ros::Time stamp = camera.stamp();
  camera.show(picture, stamp);
  const auto detections = VisionListener::of(camera.detections, stamp);
  ASSERT_TRUE(detections);
  const auto measured = VisionListener::of(camera.measured, stamp, 1.0);
  const bool moved =
      !measured || (ros_bridge::fromMsg(measured->tip).translation - before).norm() > 0.01;
  EXPECT_TRUE(moved);
  ASSERT_TRUE(reload(kVision, "demo").success);
  EXPECT_LT((tipAfterShowing() - before).norm(), 0.002);
}

// ---- Parts of nodes -----------------------------------------------------------------------------

class ReloadServer : public ::testing::Test {
 protected:
  // Answer of the server, whose callbacks run meanwhile.
  Reload::Response reload() {
    auto response = std::async(std::launch::async,
                               [this] { return test::reload(node_.getNamespace(), path_); });
    EXPECT_TRUE(waitFor(
        [&] { return response.wait_for(std::chrono::seconds(0)) == std::future_status::ready; }));
    return response.get();
  }

  ros::NodeHandle node_{"reload_server"};
  const TemporaryFile next_{demoWith({}), ".yaml"};
  const std::string path_ = std::filesystem::canonical(next_.path()).string();
  const std::string folder_ = std::filesystem::path(path_).parent_path().string();
};

TEST_F(ReloadServer, TheNewSceneIsNeverSeenWithTheOldFile) {
  std::future<std::string> seen;
  ros_bridge::ReloadServer server(node_, kDemo, folder_, [&](const io::Scene&) {
    seen = std::async(std::launch::async, [&] { return server.file().path; });
    // Time to get the old file.
    EXPECT_EQ(seen.wait_for(std::chrono::milliseconds(100)), std::future_status::timeout);
  });
  const Reload::Response response = reload();
  EXPECT_TRUE(response.success) << response.message;
  ASSERT_TRUE(seen.valid());
  EXPECT_EQ(seen.get(), path_);
}

TEST_F(ReloadServer, KeepsTheFileOfASceneThatIsNotAdopted) {
  const ros_bridge::ReloadServer server(
      node_, kDemo, folder_, [](const io::Scene&) { throw std::invalid_argument("refused"); });
  const Reload::Response response = reload();
  EXPECT_FALSE(response.success);
  EXPECT_EQ(response.message, "refused");
  EXPECT_EQ(server.file().path, kDemo);
}

// A thread of the vision nodelet fails while the other finishes its picture.
TEST(VisionStatusPublisher, NoStateFollowsAFailure) {
  ros::NodeHandle node("failed_vision");
  Inbox<VisionStatus> statuses(node, names::kVisionStatus);
  ros_bridge::VisionStatusPublisher publisher(node, "vision", "arm_base", "topic");
  ASSERT_TRUE(waitFor([&] {
    publisher.report("demo");
    return !statuses.all().empty();
  }));
  publisher.enter(VisionStatus::MEASURED, "three tags");
  publisher.close("it has failed");
  publisher.enter(VisionStatus::MEASURED, "three tags");
  publisher.refuse({ros_bridge::PictureFault::kSource, "no camera"});
  publisher.enter(VisionStatus::ENDED, "the file has ended");
  publisher.report("demo");
  // Only the report tells of the fault that was counted last.
  ASSERT_TRUE(waitFor([&] { return statuses.last().source_faults == 1; }));
  EXPECT_EQ(statuses.last().state, VisionStatus::CAMERA_FAULT);
  EXPECT_EQ(statuses.last().message, "it has failed");
}

}  // namespace
}  // namespace helix_arm::test
