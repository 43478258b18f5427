// The cloud of tips: fields, frame and points, for those who come late as well.
#include <cstring>

#include <rosgraph_msgs/Log.h>
#include <sensor_msgs/PointCloud2.h>

#include "helix_arm/Reload.h"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/statics/workspace.hpp"
#include "support/ros_rig.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::test {
namespace {

constexpr int kCount = 3000, kSeed = 5;  // as in workspace.test

TEST(WorkspaceCloud, HoldsTipsAndTheirSensitivityInTheFrameOfTheBase) {
  ros::NodeHandle node;
  Inbox<sensor_msgs::PointCloud2> clouds(node, names::kWorkspace);
  ASSERT_TRUE(waitFor([&] { return !clouds.all().empty(); }));
  const sensor_msgs::PointCloud2& cloud = clouds.last();
  EXPECT_EQ(cloud.header.frame_id, "left_arm_base");
  const char* const fields[] = {"x", "y", "z", "per_kpa_m", "per_mm_m", "per_percent_K_m"};
  ASSERT_EQ(cloud.fields.size(), 6u);
  for (std::size_t k = 0; k < 6; ++k) {
    EXPECT_EQ(cloud.fields[k].name, fields[k]);
    EXPECT_EQ(cloud.fields[k].offset, 4 * k);
    EXPECT_EQ(cloud.fields[k].datatype, sensor_msgs::PointField::FLOAT32);
    EXPECT_EQ(cloud.fields[k].count, 1u);
  }
  ASSERT_EQ(cloud.width, static_cast<unsigned>(kCount));
  EXPECT_EQ(cloud.height, 1u);
  EXPECT_EQ(cloud.point_step, 24u);
  EXPECT_EQ(cloud.row_step, 24u * kCount);
  ASSERT_EQ(cloud.data.size(), 24u * kCount);
  EXPECT_TRUE(cloud.is_dense);

  const io::Scene scene = io::loadScene(HELIX_ARM_SOURCE_DIR "/config/scenes/loaded.yaml");
  const statics::WorkspacePoints points =
      statics::Workspace(scene.model, {kSeed, true}).sample(0, kCount);
  ASSERT_EQ(points.count(), kCount);
  for (int row = 0; row < kCount; ++row) {
    float values[6];
    std::memcpy(values, cloud.data.data() + 24 * row, sizeof values);
    for (int k = 0; k < 3; ++k) {
      ASSERT_NEAR(values[k], points.tips(row, k), 1e-7);
      ASSERT_NEAR(values[3 + k], points.sensitivity(row, k), 1e-7);
    }
  }
}

TEST(WorkspaceCloud, AReloadedSceneHasACloudOfItsOwn) {
  ros::NodeHandle node;
  Inbox<sensor_msgs::PointCloud2> clouds(node, names::kWorkspace);
  ASSERT_TRUE(waitFor([&] { return !clouds.all().empty(); }));
  Reload reload;
  reload.request.scene = HELIX_ARM_SOURCE_DIR "/config/scenes/planar_76.yaml";
  ASSERT_TRUE(ros::service::call("workspace_cloud/reload", reload));
  EXPECT_FALSE(reload.response.success);
  const std::size_t before = clouds.all().size();
  reload.request.scene = HELIX_ARM_SOURCE_DIR "/config/scenes/demo.yaml";
  ASSERT_TRUE(ros::service::call("workspace_cloud/reload", reload));
  EXPECT_TRUE(reload.response.success) << reload.response.message;
  ASSERT_TRUE(waitFor([&] { return clouds.all().size() > before + 1; }));
  EXPECT_EQ(clouds.all()[before]->width, 0u);  // the old points do not stand for the new scene
  EXPECT_TRUE(clouds.all()[before]->data.empty());
  const io::Scene scene = io::loadScene(reload.request.scene);
  const Eigen::RowVector3d tip = statics::Workspace(scene.model, {kSeed, true}).sample(0, 1).tips;
  float x = 0;
  std::memcpy(&x, clouds.last().data.data(), sizeof x);
  EXPECT_NEAR(x, tip[0], 1e-7);
}

TEST(WorkspaceCloud, SaysWhyItIsEmptyAndNothingOfLoadsWhereThereAreNone) {
  ros::NodeHandle node;
  Inbox<rosgraph_msgs::Log> log(node, "/rosout");
  Inbox<sensor_msgs::PointCloud2> clouds(node, names::kWorkspace);
  ASSERT_TRUE(waitFor([&] { return log.publishers() > 1 && !clouds.all().empty(); }));
  const auto reload = [](const std::vector<io::Override>& overrides) {
    const TemporaryFile file(
        io::sceneText(HELIX_ARM_SOURCE_DIR "/config/scenes/loaded.yaml", overrides), ".yaml");
    Reload call;
    call.request.scene = file.path();
    return ros::service::call("workspace_cloud/reload", call) && call.response.success;
  };
  const auto said = [&](std::uint8_t level, const std::string& text) {
    return waitFor([&] {
      const auto& all = log.all();
      return std::any_of(all.begin(), all.end(), [&](const auto& entry) {
        return entry->name == "/workspace_cloud" && entry->level == level &&
               entry->msg.find(text) != std::string::npos;
      });
    });
  };
  ASSERT_TRUE(reload({{"name", "crushed"},
                      {"tier", "loaded"},
                      {"order", "2"},
                      {"load.tip.force_n", "[0, 0, 1e4]"}}));
  EXPECT_TRUE(said(rosgraph_msgs::Log::WARN, "crushed: the cloud of the workspace is empty"));
  EXPECT_EQ(clouds.last().width, 0u);
  ASSERT_TRUE(reload({{"name", "free"}, {"tier", "linear"}}));
  EXPECT_TRUE(said(rosgraph_msgs::Log::INFO, "free: 3000 tips by tier linear"));
  for (const auto& entry : log.all()) EXPECT_EQ(entry->msg.find("free: 0 of"), std::string::npos);
}

}  // namespace
}  // namespace helix_arm::test
