// What rviz is told to draw of arms with plates, tools and tapers.
#include <gtest/gtest.h>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/ros_bridge/common/names.hpp"
#include "helix_arm/ros_bridge/pressure/arm_markers.hpp"
#include "helix_arm/ros_bridge/vision/vision_markers.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::ros_bridge {
namespace {

using visualization_msgs::Marker;

constexpr char kScenes[] = HELIX_ARM_SOURCE_DIR "/config/scenes/";

std::vector<Marker> inNamespace(const visualization_msgs::MarkerArray& array, const char* ns) {
  std::vector<Marker> out;
  for (const Marker& marker : array.markers) {
    if (marker.ns == ns) out.push_back(marker);
  }
  return out;
}

Eigen::Vector3d fromMsg(const geometry_msgs::Point& p) { return {p.x, p.y, p.z}; }

// Of the model and of the measured shape: rviz draws no dashes from an odd number of points.
TEST(VisionMarkers, CurvesEndAtTheTipOfATool) {
  const test::TemporaryFile file(io::sceneText(std::string(kScenes) + "demo.yaml",
                                               {{"arm.tool", "{position_m: [0.05, 0.02, 0]}"}}));
  const io::Scene scene = io::loadScene(file.path());
  const model::Shape shape = scene.model.solve(Eigen::Vector3d(2e5, 0, 1e5)).shape;
  ASSERT_TRUE(shape.links());
  vision::Sight sight;
  sight.fit.shape = shape;
  const estimation::ArmView view = scene.view();
  const vision::LocalizerConfig config;
  Measurement measurement{ros::Time(5), {}, sight, view, config, {}, {}};
  measurement.model = ModelHistory::Entry{ros::Time(5), shape};
  const auto drawn = VisionMarkers("arm_base", 1.0).draw(measurement, "");
  const Eigen::Vector3d tip = model::tipPose(shape).translation;
  for (const char* ns : {names::kMeasuredCurveNs, names::kModelCurveNs}) {
    const auto markers = inNamespace(drawn, ns);
    ASSERT_EQ(markers.size(), 1U) << ns;
    ASSERT_GT(markers[0].points.size(), 2U) << ns;
    EXPECT_LT((fromMsg(markers[0].points.back()) - tip).norm(), 1e-12) << ns;
  }
  const Marker dashes = inNamespace(drawn, names::kModelCurveNs)[0];
  EXPECT_EQ(dashes.type, Marker::LINE_LIST);
  EXPECT_EQ(dashes.points.size() % 2, 0U);
  const Eigen::Vector3d last =
      fromMsg(dashes.points.back()) - fromMsg(dashes.points[dashes.points.size() - 2]);
  EXPECT_NEAR(last.norm(), Eigen::Vector2d(0.05, 0.02).norm(), 1e-12) << "along the tool";
}

TEST(ArmMarkers, SeparatorsOfATaperedArmShrinkWithIt) {
  const io::Scene scene = io::loadScene(std::string(kScenes) + "tapered_50_25.yaml");
  const Eigen::VectorXd pressure = Eigen::Vector3d(2e5, 0, 1e5);
  ArmMarkers markers(scene, "arm_base", 1.0);
  const auto discs =
      inNamespace(markers.draw(scene.model.solve(pressure).shape, pressure, ros::Time(5)),
                  names::kSeparatorsNs);
  ASSERT_EQ(discs.size(), 12U);
  const double first = 2 * scene.looks[0].separator_radius;
  for (std::size_t k = 0; k < discs.size(); ++k) {
    EXPECT_NEAR(discs[k].scale.x, first * (1 - 0.5 * static_cast<double>(k) / 11), 1e-9) << k;
  }
}

// Its texts are behind its base: the view is from the side.
TEST(ArmMarkers, TextsAreClearOfAnArmThatLeavesItsBaseSideways) {
  for (const char* name : {"demo", "tapered_50_25"}) {
    const io::Scene scene = io::loadScene(kScenes + std::string(name) + ".yaml");
    const Eigen::VectorXd pressure = Eigen::Vector3d::Zero();
    ArmMarkers markers(scene, "arm_base", 1.0);
    const auto drawn = markers.draw(scene.model.solve(pressure).shape, pressure, ros::Time(5));
    const double radius = scene.looks[0].separator_radius;
    for (const char* ns : {names::kLegendNs, names::kPressuresNs}) {
      for (const Marker& text : inNamespace(drawn, ns)) {
        const Eigen::Vector3d at = fromMsg(text.pose.position);
        const bool beside = at.tail<2>().norm() > 2 * radius, behind = at.x() < -2 * radius;
        EXPECT_TRUE(beside || behind) << name << " " << ns << ": " << at.transpose();
      }
    }
    EXPECT_EQ(inNamespace(drawn, names::kLegendNs)
                  .at(0)
                  .pose.position.x<-radius, scene.X_WB.rotation.col(0).z()> -
              0.5)
        << name;
  }
}

}  // namespace
}  // namespace helix_arm::ros_bridge
