// Parts of nodes, each on its own.
#include <chrono>
#include <filesystem>
#include <future>
#include <stdexcept>
#include <string>

#include <gtest/gtest.h>
#include <ros/service.h>

#include "helix_arm/Reload.h"
#include "helix_arm/VisionStatus.h"
#include "helix_arm/io/scene.hpp"
#include "ros_bridge/common/reload_server.hpp"
#include "ros_bridge/vision/vision_status_publisher.hpp"
#include "support/ros_rig.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::test {
namespace {

constexpr char kDemo[] = HELIX_ARM_SOURCE_DIR "/config/scenes/demo.yaml";

class ReloadServer : public ::testing::Test {
 protected:
  // Answer of the server, whose callbacks run meanwhile.
  Reload::Response reload() {
    auto response = std::async(std::launch::async, [this] {
      Reload call;
      call.request.scene = path_;
      EXPECT_TRUE(ros::service::waitForService(node_.resolveName(names::kReload), 10000));
      EXPECT_TRUE(ros::service::call(node_.resolveName(names::kReload), call));
      return call.response;
    });
    EXPECT_TRUE(waitFor(
        [&] { return response.wait_for(std::chrono::seconds(0)) == std::future_status::ready; }));
    return response.get();
  }

  ros::NodeHandle node_{"reload_server"};
  const TemporaryFile next_{io::sceneText(kDemo), ".yaml"};
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
  ros_bridge::VisionStatusPublisher publisher(node, {}, "vision", "arm_base");
  ASSERT_TRUE(waitFor([&] {
    publisher.report("demo");
    return !statuses.all().empty();
  }));
  publisher.enter(VisionStatus::MEASURED, "three tags");
  publisher.fail("it has failed");
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
