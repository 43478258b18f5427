// Which views of rviz a cockpit changes, and what they then show.
#include "ros_bridge/cockpit/arm_camera.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

#include <gtest/gtest.h>

namespace helix_arm::ros_bridge {
namespace {

constexpr double kField = 0.785;  // of rviz, from bottom to top [rad]

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
  struct Mounting {
    const char* name;
    Eigen::Vector3d axis;
  };
  const std::vector<Mounting> mountings = {{"hanging", {0, 0, -1}},
                                           {"standing", {0, 0, 1}},
                                           {"horizontal", {1, 0, 0}},
                                           {"horizontal, to the side", {0, -1, 0}},
                                           {"slanting", {1, 1, -1}}};
  for (const auto& [name, axis] : mountings) {
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
            EXPECT_LT(seen.cwiseAbs().maxCoeff(), 1.0) << name << ", " << length << ", " << aspect;
          }
        }
        const Eigen::Vector2d span =
            inPicture(tip, camera, aspect) - inPicture(Eigen::Vector3d::Zero(), camera, aspect);
        const double in_shorter_sides =
            0.5 * Eigen::Vector2d(aspect * span.x(), span.y()).norm() / std::min(aspect, 1.0);
        EXPECT_GT(in_shorter_sides, 0.25) << name << ", " << length << ", " << aspect;
      }
    }
  }
}

TEST(ArmCamera, AViewThatAUserMovedKeepsFocusAnglesAndDistance) {
  const ArmCamera mine{"arm_base", {0.1, 0, 0}, 1.0, 0.5, 2.0};
  EXPECT_FALSE(isToChange(mine, "arm_base"));
  ASSERT_TRUE(isToChange(mine, "left_arm_base")) << "no arm has this frame";
  const ArmCamera next = changed(mine, "left_arm_base", -Eigen::Vector3d::UnitZ(), 0.3, 1.0);
  EXPECT_EQ(next.target, "left_arm_base");
  EXPECT_EQ(next.focus, mine.focus);
  EXPECT_EQ(next.yaw, mine.yaw);
  EXPECT_EQ(next.pitch, mine.pitch);
  EXPECT_EQ(next.distance, mine.distance);
  EXPECT_FALSE(isToChange(next, "left_arm_base"));
}

TEST(ArmCamera, AViewOfWhateverIsNoArmStays) {
  EXPECT_FALSE(isToChange({"world", {0, 0, 0}, 1, 0.5, 2}, "arm_base"));
  EXPECT_FALSE(isToChange({"<Fixed Frame>", {0, 0, 0}, 1, 0.5, 2}, "left_arm_base"));
}

// The first cockpit that knows its arm takes the view; the other leaves it alone from then on.
TEST(ArmCamera, OfTwoArmsOneHasTheView) {
  const ArmCamera start{"arm_base", {0, 0, 0}, 1, 0.5, 2};
  ASSERT_TRUE(isToChange(start, "left_arm_base"));
  ASSERT_TRUE(isToChange(start, "right_arm_base"));
  const ArmCamera taken = changed(start, "right_arm_base", -Eigen::Vector3d::UnitZ(), 0.3, 1.0);
  EXPECT_FALSE(isToChange(taken, "left_arm_base"));
  EXPECT_FALSE(isToChange(taken, "right_arm_base"));
  // A configuration that looks exactly at the base of one of them.
  const ArmCamera right{"right_arm_base", {0, 0, 0}, 1, 0.5, 2};
  EXPECT_FALSE(isToChange(right, "left_arm_base"));
  EXPECT_TRUE(isToChange(right, "right_arm_base"));
}

}  // namespace
}  // namespace helix_arm::ros_bridge
