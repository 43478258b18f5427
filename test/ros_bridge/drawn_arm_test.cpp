// What rviz is told to draw of arms with plates, tools and tapers, of their loops, and from where.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include <gtest/gtest.h>

#include "ros_bridge/cockpit/cockpit_view.hpp"
#include "ros_bridge/common/arm_markers.hpp"
#include "support/shipped_scene.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::ros_bridge {
namespace {

using visualization_msgs::Marker;

constexpr char kTwoSections[] = HELIX_ARM_SOURCE_DIR "/test/ros_bridge/scenes/brisk.yaml";

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
  const test::TemporaryFile file(
      io::sceneText(test::shippedPath("demo"), {{"arm.tool", "{position_m: [0.05, 0.02, 0]}"}}));
  const io::Scene scene = io::loadScene(file.path());
  const model::Shape shape = scene.model.solve(Eigen::Vector3d(2e5, 0, 1e5)).shape;
  ASSERT_TRUE(shape.links());
  estimation::TwistFit fit;
  fit.shape = shape;
  const auto drawn =
      VisionMarkers("arm_base", 1.0)
          .draw(ros::Time(5), sideViewOf(scene), scene.view().layout, fit, &shape, "");
  const Eigen::Vector3d tip = model::tipPose(shape).translation;
  for (const char* ns : {"measured_curve", "model_curve"}) {
    const auto markers = inNamespace(drawn, ns);
    ASSERT_EQ(markers.size(), 1U) << ns;
    ASSERT_GT(markers[0].points.size(), 2U) << ns;
    EXPECT_LT((fromMsg(markers[0].points.back()) - tip).norm(), 1e-12) << ns;
  }
  const Marker dashes = inNamespace(drawn, "model_curve")[0];
  EXPECT_EQ(dashes.type, Marker::LINE_LIST);
  EXPECT_EQ(dashes.points.size() % 2, 0U);
  const Eigen::Vector3d last =
      fromMsg(dashes.points.back()) - fromMsg(dashes.points[dashes.points.size() - 2]);
  EXPECT_NEAR(last.norm(), Eigen::Vector2d(0.05, 0.02).norm(), 1e-12) << "along the tool";
}

// What is drawn of an arm at these pressures.
visualization_msgs::MarkerArray draw(ArmMarkers& markers, const io::Scene& scene,
                                     const Eigen::VectorXd& pressure) {
  return markers.draw(scene.model.solve(pressure).shape, pressure, ros::Time(5));
}

TEST(ArmMarkers, HaveStableNamesAndOutliveTheirPeriod) {
  const io::Scene scene = io::loadScene(kTwoSections);
  ArmMarkers markers(scene, "arm_base", 0.5);
  Eigen::VectorXd pressure = Eigen::VectorXd::Zero(7);
  std::set<std::pair<std::string, int>> first;
  for (int i = 0; i < 5; ++i, pressure[0] += 5e4) {
    const auto drawn = draw(markers, scene, pressure);
    if (i == 0) continue;  // the trace begins with the arm's first motion
    std::map<std::string, int> count;
    std::set<std::pair<std::string, int>> keys;
    for (const Marker& marker : drawn.markers) {
      EXPECT_TRUE(keys.emplace(marker.ns, marker.id).second) << marker.ns << " " << marker.id;
      ++count[marker.ns];
      EXPECT_EQ(marker.header.frame_id, "arm_base");
      EXPECT_EQ(marker.action, Marker::ADD);
      EXPECT_GT(marker.lifetime.toSec(), 1.0);
      EXPECT_GT(marker.color.a, 0.0F);
      const auto& q = marker.pose.orientation;
      EXPECT_NEAR(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w, 1.0, 1e-9);
      for (const auto& p : marker.points) ASSERT_TRUE(std::isfinite(p.x + p.y + p.z));
    }
    EXPECT_EQ(count["muscles"], 7);
    EXPECT_EQ(count["pressures"], 7);
    EXPECT_EQ(count["separators"], scene.looks[0].separators + scene.looks[1].separators);
    EXPECT_EQ(count["base_curve"], 1);
    EXPECT_EQ(count["tip_trace"], 1);
    if (i == 1) first = keys;
    EXPECT_EQ(keys, first);
  }
}

LoopMarkers::Tips sample() {
  LoopMarkers::Tips out;
  out.wanted = Eigen::Vector3d(0.4, 0.1, 0);
  out.predicted = Eigen::Vector3d(0.4, 0, 0);
  out.covariance = Eigen::Vector3d(1e-6, 4e-6, 9e-6).asDiagonal();
  out.text = "closed, 0.20 mm";
  out.budget = "0.20 mm camera\ninside";
  return out;
}

// After a drawing of everything.
Marker drawn(const LoopMarkers::Tips& tips, const std::string& ns) {
  Eigen::Matrix3d R_WB;  // it hangs
  R_WB << 0, 0, 1, 0, 1, 0, -1, 0, 0;
  const SideView view = seenFrom(R_WB, sideView(R_WB.col(0), 0.3, 0.03));
  LoopMarkers markers("arm_base", 1.0);
  LoopMarkers::Tips everything = sample();
  everything.force = Eigen::Vector3d(0, 0, 1);
  markers.draw(ros::Time(4), view, everything);
  return inNamespace(markers.draw(ros::Time(5), view, tips), ns.c_str()).at(0);
}

TEST(LoopMarkers, WhatIsAbsentIsRemoved) {
  LoopMarkers::Tips tips = sample();
  tips.budget.clear();
  EXPECT_EQ(drawn(tips, "error_budget").action, Marker::DELETE);
  EXPECT_EQ(drawn(tips, "loop_state").action, Marker::ADD);
  EXPECT_EQ(drawn(tips, "tip_force").action, Marker::DELETE);
  tips = sample();
  tips.predicted.reset();
  for (const char* ns : {"error_budget", "loop_state", "predicted_tip", "predicted_covariance"}) {
    EXPECT_EQ(drawn(tips, ns).action, Marker::DELETE) << ns;
  }
  EXPECT_EQ(drawn(tips, "wanted_tip").action, Marker::ADD);
}

constexpr double kField = 0.785;  // of rviz, from bottom to top [rad]

// The eye of rviz/Orbit is at focus + distance times this; up is z.
Eigen::Vector3d toEye(const ArmCamera& camera) {
  return {std::cos(camera.yaw) * std::cos(camera.pitch),
          std::sin(camera.yaw) * std::cos(camera.pitch), std::sin(camera.pitch)};
}
// A point in its picture, in shares of half its width and height.
Eigen::Vector2d inPicture(const Eigen::Vector3d& point, const ArmCamera& camera, double aspect) {
  const Eigen::Vector3d to_eye = toEye(camera);
  const Eigen::Vector3d right = Eigen::Vector3d::UnitZ().cross(to_eye).normalized();
  const Eigen::Vector3d up = to_eye.cross(right);
  const Eigen::Vector3d from = point - camera.focus;
  const double half = (camera.distance - from.dot(to_eye)) * std::tan(0.5 * kField);
  return {from.dot(right) / (half * aspect), from.dot(up) / half};
}

// Seen from its side, all of it is in sight with its texts, and it takes more than a quarter of the
// picture's shorter side. The rest is for the texts beside it.
TEST(ArmCamera, TheArmFillsTheViewWhateverItsMountingIs) {
  // Along the arm: hanging, standing, horizontal, to the side, slanting.
  const Eigen::Vector3d mountings[] = {{0, 0, -1}, {0, 0, 1},  {1, 0, 0},
                                       {0, -1, 0}, {1, 1, -1}, {-1, 0, 1}};
  for (const Eigen::Vector3d& axis : mountings) {
    for (const auto& [length, aspect] :
         {std::pair(0.1, 0.87), {0.3, 0.6}, {0.3, 0.87}, {0.3, 1.8}, {1.2, 0.87}}) {
      SCOPED_TRACE(::testing::Message() << axis.transpose() << ", " << length << ", " << aspect);
      const ArmCamera camera =
          changed({"arm_base", {0, 0, 0}, 2, 1, 10}, "left_arm_base", axis, length, aspect);
      EXPECT_EQ(camera.target, "left_arm_base");
      const Eigen::Vector3d along = axis.normalized(), tip = length * along, base(0, 0, 0);
      EXPECT_LT(std::abs(toEye(camera).dot(along)), 0.2);
      const Eigen::Vector3d side =
          0.1 * length * along.cross(Eigen::Vector3d(0.3, 0.5, 0.8)).normalized();
      const SideView view = sideView(axis, length, 0.1 * length);
      for (const Eigen::Vector3d& point :
           {Eigen::Vector3d(base + side), Eigen::Vector3d(base - side), Eigen::Vector3d(tip + side),
            Eigen::Vector3d(tip - side), view.headline, view.legend_top, view.table_top}) {
        EXPECT_LT(inPicture(point, camera, aspect).cwiseAbs().maxCoeff(), 1.0) << point.transpose();
      }
      const Eigen::Vector2d span = inPicture(tip, camera, aspect) - inPicture(base, camera, aspect);
      const double in_shorter_sides =
          0.5 * Eigen::Vector2d(aspect * span.x(), span.y()).norm() / std::min(aspect, 1.0);
      EXPECT_GT(in_shorter_sides, 0.25);
    }
  }
}

}  // namespace
}  // namespace helix_arm::ros_bridge
