// What rviz is told to draw of arms with plates, tools and tapers.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <string>

#include <gtest/gtest.h>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/curve.hpp"
#include "ros_bridge/names.hpp"
#include "ros_bridge/pressure/shape_publisher.hpp"
#include "ros_bridge/vision/vision_status_publisher.hpp"
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
  vision::Observation observation;
  observation.fit.shape = shape;
  const estimation::ArmView view = scene.view();
  const vision::LocalizerConfig config;
  Measurement measurement{ros::Time(5), {}, observation, view, config, {}, {}};
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

TEST(ArmMarkers, TextsAreClearOfTheArmWhateverItsMountingIs) {
  for (const char* name : {"demo", "tapered_50_25", "spatial_50"}) {
    const io::Scene scene = io::loadScene(kScenes + std::string(name) + ".yaml");
    const Eigen::VectorXd pressure = Eigen::VectorXd::Zero(scene.arm.actuatorCount());
    ArmMarkers markers(scene, "arm_base", 1.0);
    const auto drawn = markers.draw(scene.model.solve(pressure).shape, pressure, ros::Time(5));
    const double radius = scene.looks[0].separator_radius;
    for (const char* ns : {names::kLegendNs, names::kPressuresNs}) {
      for (const Marker& text : inNamespace(drawn, ns)) {
        const Eigen::Vector3d at = fromMsg(text.pose.position);
        EXPECT_GT(at.tail<2>().norm(), 2 * radius) << name << " " << ns << ": " << at.transpose();
      }
    }
  }
}

// Half the height of a text of n lines [m].
double halfHeight(const Marker& text) {
  const auto lines = 1 + std::count(text.text.begin(), text.text.end(), '\n');
  return 0.5 * static_cast<double>(lines) * kLineSpacing * text.scale.z;
}

TEST(ArmMarkers, AReasonOfAnyLengthCoversNeitherStateNorLegend) {
  std::string reason = "vented: no pressure remains";
  for (const char* name : {"demo", "spatial_50"}) {
    const io::Scene scene = io::loadScene(kScenes + std::string(name) + ".yaml");
    const Eigen::VectorXd pressure = Eigen::VectorXd::Zero(scene.arm.actuatorCount());
    ArmMarkers markers(scene, "arm_base", 1.0);
    for (int words = 0; words < 100; words += 9) {
      for (int k = 0; k < 9; ++k) reason += " remedy";
      markers.tell({}, reason);
      const auto drawn = markers.draw(scene.model.solve(pressure).shape, pressure, ros::Time(5));
      const auto banner = inNamespace(drawn, names::kStateBannerNs);
      const auto legend = inNamespace(drawn, names::kLegendNs);
      ASSERT_EQ(banner.size(), 2U);
      ASSERT_FALSE(legend.empty());
      const auto height = [&](const Marker& text) {
        return (scene.X_WB.rotation * fromMsg(text.pose.position)).z();
      };
      const Marker &why = banner[0].id == 1 ? banner[0] : banner[1],
                   &state = banner[0].id == 1 ? banner[1] : banner[0];
      EXPECT_LT(height(why) + halfHeight(why), height(state)) << name << words;
      EXPECT_GT(height(why) - halfHeight(why), height(legend[0]) + halfHeight(legend[0]))
          << name << words;
    }
    EXPECT_GE(std::count(reason.begin(), reason.end(), ' '), 100);
  }
}

TEST(ArmMarkers, AnArmInANamespaceHasItsNameAboveIt) {
  const io::Scene scene = io::loadScene(std::string(kScenes) + "demo.yaml");
  const Eigen::VectorXd pressure = Eigen::Vector3d::Zero();
  const model::Shape shape = scene.model.solve(pressure).shape;
  const auto state = [&](const char* base_frame) {
    return inNamespace(ArmMarkers(scene, base_frame, 1.0).draw(shape, pressure, ros::Time(5)),
                       names::kStateBannerNs)
        .at(0)
        .text;
  };
  EXPECT_EQ(state("arm_base"), "DISABLED");
  EXPECT_EQ(state("left_arm_base"), "left: DISABLED");
}

// Corners of the arm in the picture of the orbiting camera, in shares of half its size.
TEST(SideView, ShowsTheWholeArmFromItsSideWhateverItsMountingIs) {
  constexpr double kField = 0.785, kAspect = 0.87;
  for (const Eigen::Vector3d& axis :
       {Eigen::Vector3d(0, 0, -1), Eigen::Vector3d(0, 0, 1), Eigen::Vector3d(1, 0, 0),
        Eigen::Vector3d(0, -1, 0), Eigen::Vector3d(1, 1, -1), Eigen::Vector3d(-1, 0, 1)}) {
    for (const double length : {0.1, 0.3, 1.2}) {
      const SideView view = sideView(axis, length, 0.1 * length);
      const Eigen::Vector3d to_camera(std::cos(view.yaw) * std::cos(view.pitch),
                                      std::sin(view.yaw) * std::cos(view.pitch),
                                      std::sin(view.pitch));
      EXPECT_LT(std::abs(to_camera.dot(axis.normalized())), 0.2) << axis.transpose();
      const double distance = view.distance(kField, kAspect), half = std::tan(0.5 * kField);
      const Eigen::Vector3d up = to_camera.cross(view.right);
      const Eigen::Vector3d tip = length * axis.normalized();
      for (const Eigen::Vector3d& point :
           {Eigen::Vector3d(0, 0, 0), tip, view.headline, view.legend_top, view.table_top}) {
        const Eigen::Vector3d from = point - view.centre;
        const double depth = distance - from.dot(to_camera);
        const double x = from.dot(view.right) / (depth * half * kAspect),
                     y = from.dot(up) / (depth * half);
        EXPECT_LT(std::abs(x), 0.95) << axis.transpose() << ", " << length;
        EXPECT_LT(std::abs(y), 0.98) << axis.transpose() << ", " << length;
      }
      const double seen = (tip - tip.dot(to_camera) * to_camera).norm();
      EXPECT_GT(seen / (2 * distance * half), 0.28) << axis.transpose() << ", " << length;
    }
  }
}

}  // namespace
}  // namespace helix_arm::ros_bridge
