// What rviz is told to draw of arms with plates, tools and tapers, of their loops, and from where.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <tuple>

#include <gtest/gtest.h>

#include "ros_bridge/cockpit/cockpit_view.hpp"
#include "ros_bridge/common/arm_markers.hpp"
#include "ros_bridge/names.hpp"
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

TEST(ArmMarkers, SeparatorsOfATaperedArmShrinkWithIt) {
  const io::Scene scene = io::loadScene(std::string(kScenes) + "tapered_50_25.yaml");
  const Eigen::VectorXd pressure = Eigen::Vector3d(2e5, 0, 1e5);
  ArmMarkers markers(scene, "arm_base", 1.0);
  const auto discs = inNamespace(
      markers.draw(scene.model.solve(pressure).shape, pressure, ros::Time(5)), "separators");
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
    for (const char* ns : {"legend", "pressures"}) {
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
      const auto banner = inNamespace(drawn, "state_banner");
      const auto legend = inNamespace(drawn, "legend");
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
                       "state_banner")
        .at(0)
        .text;
  };
  EXPECT_EQ(state("arm_base"), "DISABLED");
  EXPECT_EQ(state("left_arm_base"), "left: DISABLED");
}

constexpr double kField = 0.785;  // of rviz, from bottom to top [rad]
// Along the arm: hanging, standing, horizontal, to the side, slanting.
const Eigen::Vector3d kMountings[] = {{0, 0, -1}, {0, 0, 1},  {1, 0, 0},
                                      {0, -1, 0}, {1, 1, -1}, {-1, 0, 1}};

// Corners of the arm in the picture of the orbiting camera, in shares of half its size.
TEST(SideView, ShowsTheWholeArmFromItsSideWhateverItsMountingIs) {
  constexpr double kAspect = 0.87;
  for (const Eigen::Vector3d& axis : kMountings) {
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

TEST(LoopMarkers, TheBudgetIsATableBesideTheEllipsoid) {
  const Marker table = drawn(sample(), "error_budget");
  EXPECT_EQ(table.action, Marker::ADD);
  EXPECT_EQ(table.type, Marker::TEXT_VIEW_FACING);
  EXPECT_EQ(table.text, sample().budget);
  EXPECT_EQ(table.header.frame_id, "arm_base");
  const Marker ellipsoid = drawn(sample(), "predicted_covariance");
  EXPECT_NEAR(ellipsoid.scale.x + ellipsoid.scale.y + ellipsoid.scale.z, 4 * (1 + 2 + 3) * 1e-3,
              1e-9);
  EXPECT_GT(table.pose.position.y - ellipsoid.pose.position.y, ellipsoid.scale.y);
  EXPECT_NE(table.pose.position.y, drawn(sample(), "loop_state").pose.position.y);
}

// The same markers draw an arm that is mounted otherwise.
TEST(LoopMarkers, TheStateIsBelowTheTipAlsoOnceTheArmIsMountedOtherwise) {
  LoopMarkers markers("arm_base", 1.0);
  Eigen::Matrix3d hangs, rolled;
  hangs << 0, 0, 1, 0, 1, 0, -1, 0, 0;
  rolled << 0, 0, 1, 1, 0, 0, 0, 1, 0;  // runs along y
  for (const Eigen::Matrix3d& R_WB : {hangs, rolled, hangs}) {
    const SideView view = seenFrom(R_WB, sideView(R_WB.col(0), 0.3, 0.03));
    const auto state = inNamespace(markers.draw(ros::Time(5), view, sample()), "loop_state");
    ASSERT_EQ(state.size(), 1U);
    const Eigen::Vector3d beyond = R_WB * (fromMsg(state[0].pose.position) - *sample().predicted);
    EXPECT_LT(beyond.z(), -0.01);
    EXPECT_LT(beyond.head<2>().norm(), 1e-12);
  }
}

TEST(LoopMarkers, ABudgetThatIsContradictedHasAnotherColour) {
  LoopMarkers::Tips tips = sample();
  tips.outside = true;
  EXPECT_NE(drawn(tips, "error_budget").color.r, drawn(sample(), "error_budget").color.r);
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

// A point in the picture of rviz/Orbit, in shares of half its width and height. Its eye is at
// focus + distance (cos yaw cos pitch, sin yaw cos pitch, sin pitch); up is z.
Eigen::Vector2d inPicture(const Eigen::Vector3d& point, const ArmCamera& camera, double aspect) {
  const Eigen::Vector3d to_eye(std::cos(camera.yaw) * std::cos(camera.pitch),
                               std::sin(camera.yaw) * std::cos(camera.pitch),
                               std::sin(camera.pitch));
  const Eigen::Vector3d right = Eigen::Vector3d::UnitZ().cross(to_eye).normalized();
  const Eigen::Vector3d up = to_eye.cross(right);
  const Eigen::Vector3d from = point - camera.focus;
  const double half = (camera.distance - from.dot(to_eye)) * std::tan(0.5 * kField);
  return {from.dot(right) / (half * aspect), from.dot(up) / half};
}

// The arm fills the view: all of it is in sight, and it takes more than a quarter of the picture's
// shorter side. The rest is for the texts beside it.
TEST(ArmCamera, TheArmFillsTheViewWhateverItsMountingIs) {
  for (const Eigen::Vector3d& axis : kMountings) {
    for (const double length : {0.1, 0.3, 1.2}) {
      for (const double aspect : {0.6, 0.87, 1.8}) {
        const ArmCamera camera =
            changed({"arm_base", {0, 0, 0}, 2, 1, 10}, "left_arm_base", axis, length, aspect);
        EXPECT_EQ(camera.target, "left_arm_base");
        const Eigen::Vector3d along = axis.normalized(), tip = length * along;
        const Eigen::Vector3d side =
            0.1 * length * along.cross(Eigen::Vector3d(0.3, 0.5, 0.8)).normalized();
        for (const Eigen::Vector3d& base : {Eigen::Vector3d(0, 0, 0), tip}) {
          for (const Eigen::Vector3d& point :
               {Eigen::Vector3d(base + side), Eigen::Vector3d(base - side)}) {
            const Eigen::Vector2d seen = inPicture(point, camera, aspect);
            EXPECT_LT(seen.cwiseAbs().maxCoeff(), 1.0)
                << axis.transpose() << ", " << length << ", " << aspect;
          }
        }
        const Eigen::Vector2d span =
            inPicture(tip, camera, aspect) - inPicture(Eigen::Vector3d::Zero(), camera, aspect);
        const double in_shorter_sides =
            0.5 * Eigen::Vector2d(aspect * span.x(), span.y()).norm() / std::min(aspect, 1.0);
        EXPECT_GT(in_shorter_sides, 0.25) << axis.transpose() << ", " << length << ", " << aspect;
      }
    }
  }
}

// The first cockpit that knows its arm takes the view; the other leaves it alone from then on, and
// a view that a user moved keeps focus, angles and distance.
TEST(ArmCamera, IsTakenOnceAndKeepsWhatAUserHasMoved) {
  const struct {
    const char *target, *base;
    bool changes;
  } kRows[] = {{"arm_base", "arm_base", true},
               {"arm_base", "left_arm_base", true},
               {"arm_base", "right_arm_base", true},
               {"right_arm_base", "right_arm_base", true},
               {"right_arm_base", "left_arm_base", false},
               {"world", "arm_base", false},
               {"<Fixed Frame>", "left_arm_base", false}};
  const Eigen::Vector3d down = -Eigen::Vector3d::UnitZ();
  for (const auto& row : kRows) {
    SCOPED_TRACE(std::string(row.target) + ", " + row.base);
    const ArmCamera start{row.target, {0, 0, 0}, 1, 0.5, 2};
    ASSERT_EQ(isToChange(start, row.base), row.changes);
    if (!row.changes) continue;
    const ArmCamera taken = changed(start, row.base, down, 0.3, 1.0);
    EXPECT_FALSE(isToChange(taken, row.base));
    for (const char* other : {"left_arm_base", "right_arm_base"}) {
      EXPECT_EQ(isToChange(taken, other), taken.target == "arm_base") << other;
    }
  }
  const ArmCamera mine{"arm_base", {0.1, 0, 0}, 1.0, 0.5, 2.0};
  EXPECT_FALSE(isToChange(mine, "arm_base"));
  ASSERT_TRUE(isToChange(mine, "left_arm_base")) << "no arm has this frame";
  const ArmCamera next = changed(mine, "left_arm_base", down, 0.3, 1.0);
  EXPECT_EQ(next.target, "left_arm_base");
  EXPECT_EQ(next.focus, mine.focus);
  EXPECT_EQ(std::tie(next.yaw, next.pitch, next.distance),
            std::tie(mine.yaw, mine.pitch, mine.distance));
}

}  // namespace
}  // namespace helix_arm::ros_bridge
