// What rviz gets: frames and markers.
#include <cmath>
#include <set>

#include <tf2_msgs/TFMessage.h>
#include <visualization_msgs/MarkerArray.h>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/curve.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "support/ros_rig.hpp"

namespace helix_arm::test {
namespace {

using visualization_msgs::Marker;
using visualization_msgs::MarkerArray;

constexpr int kFrames = 9;  // as in drawing.test

lie::SE3 poseOf(const geometry_msgs::Transform& t) {
  const Eigen::Quaterniond q(t.rotation.w, t.rotation.x, t.rotation.y, t.rotation.z);
  return {q.toRotationMatrix(), {t.translation.x, t.translation.y, t.translation.z}};
}

double distance(const lie::SE3& a, const lie::SE3& b) {
  return (a.translation - b.translation).norm() + (a.rotation - b.rotation).norm();
}

class Drawing : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(rig_.connect());
    rig_.keepOn();
    ASSERT_EQ(rig_.sendPressures({3e5, 0, 0, 0, 0, 2e5, 0}).outcome, TargetStatus::REACHED);
  }

  const io::Scene scene_ = io::loadScene(HELIX_ARM_SOURCE_DIR "/test/ros_bridge/scenes/brisk.yaml");
  Rig rig_;
  ros::NodeHandle node_;
  Inbox<tf2_msgs::TFMessage> tf_{node_, "/tf"}, static_tf_{node_, "/tf_static"};
  Inbox<MarkerArray> markers_{node_, names::kMarkers};
};

TEST_F(Drawing, EveryFrameHasOneParentAndHangsFromTheWorld) {
  ASSERT_TRUE(waitFor([this] { return !tf_.all().empty() && !static_tf_.all().empty(); }));
  ASSERT_TRUE(tf_.next([](const auto&) { return true; }));
  std::map<std::string, std::set<std::string>> parents;
  for (const auto* inbox : {&tf_, &static_tf_}) {
    for (const auto& message : inbox->all()) {
      for (const auto& t : message->transforms) parents[t.child_frame_id].insert(t.header.frame_id);
    }
  }
  std::set<std::string> expected = {"arm_base", "model_tip"};
  for (int k = 0; k < kFrames; ++k) expected.insert("model_" + std::to_string(k));
  for (const auto& [child, of_child] : parents) {
    EXPECT_EQ(expected.count(child), 1U) << child;
    EXPECT_EQ(of_child.size(), 1U) << child;
    EXPECT_EQ(*of_child.begin(), child == "arm_base" ? "world" : "arm_base");
  }
  EXPECT_EQ(parents.size(), expected.size());
}

TEST_F(Drawing, TheBaseHasThePoseOfTheScene) {
  ASSERT_TRUE(waitFor([this] { return !static_tf_.all().empty(); }));
  EXPECT_LT(distance(poseOf(static_tf_.last().transforms.at(0).transform), scene_.X_WB), 1e-12);
}

TEST_F(Drawing, FramesLieOnTheModelOfTheSameStamp) {
  for (int i = 0; i < 10; ++i) {
    ArmShape::ConstPtr model;
    const auto tf = tf_.next([&](const tf2_msgs::TFMessage& message) {
      for (const auto& m : rig_.model.all()) {
        if (m->header.stamp == message.transforms.at(0).header.stamp) model = m;
      }
      return model != nullptr;
    });
    ASSERT_TRUE(tf && model);
    const model::Twists twists = Eigen::Map<const model::Twists>(model->twist.data(), 6, 2);
    std::map<std::string, lie::SE3> X;
    for (const auto& t : tf->transforms) X[t.child_frame_id] = poseOf(t.transform);
    for (int k = 0; k < kFrames; ++k) {
      const double s = 2.0 * k / (kFrames - 1);
      EXPECT_LT(distance(X.at("model_" + std::to_string(k)), model::poseAt(twists, s)), 1e-12);
    }
    EXPECT_LT(distance(X.at("model_tip"), ros_bridge::fromMsg(model->tip)), 1e-12);
    EXPECT_LT(distance(X.at("model_0"), lie::SE3{}), 1e-12);
  }
}

TEST_F(Drawing, MarkersHaveStableNamesAndOutliveTheirPeriod) {
  using Key = std::pair<std::string, int>;
  std::set<Key> first;
  for (int i = 0; i < 5; ++i) {
    // The trace begins with the arm's first motion.
    const auto array = markers_.next([](const MarkerArray& a) {
      for (const Marker& m : a.markers) {
        if (m.ns == "tip_trace") return true;
      }
      return false;
    });
    ASSERT_TRUE(array);
    std::map<std::string, int> count;
    std::set<Key> keys;
    for (const Marker& marker : array->markers) {
      EXPECT_TRUE(keys.emplace(marker.ns, marker.id).second) << marker.ns << " " << marker.id;
      ++count[marker.ns];
      EXPECT_EQ(marker.header.frame_id, "arm_base");
      EXPECT_EQ(marker.action, Marker::ADD);
      EXPECT_GT(marker.lifetime.toSec(), 2.0 / 25);
      EXPECT_GT(marker.color.a, 0.0F);
      const auto& q = marker.pose.orientation;
      EXPECT_NEAR(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w, 1.0, 1e-9);
      for (const auto& p : marker.points) ASSERT_TRUE(std::isfinite(p.x + p.y + p.z));
    }
    EXPECT_EQ(count["muscles"], 7);
    EXPECT_EQ(count["pressures"], 7);
    EXPECT_EQ(count["separators"], scene_.looks[0].separators + scene_.looks[1].separators);
    EXPECT_EQ(count["base_curve"], 1);
    EXPECT_EQ(count["tip_trace"], 1);
    if (i == 0) first = keys;
    EXPECT_EQ(keys, first);
  }
}

TEST_F(Drawing, TubesFollowTheirMusclesAndTheTextShowsThePressure) {
  // Without noise the pressures settle on the command, and the drawing with them.
  const Eigen::VectorXd q = (Eigen::VectorXd(7) << 3e5, 0, 0, 0, 0, 2e5, 0).finished();
  const model::Twists twists = scene_.arm.twists(q);
  const lie::SE3 X_end = model::poseAt(twists, 1.0) * scene_.arm.actuator(0).X_O;
  EXPECT_TRUE(markers_.next([&](const MarkerArray& array) {
    bool at_muscle = false, tells = false;
    for (const Marker& m : array.markers) {
      if (m.ns == "muscles" && m.id == 0 && m.points.size() % 3 == 0) {
        // The last triangles of the tube end on the circle around the muscle's end.
        const auto& p = m.points.back();
        const double off = (Eigen::Vector3d(p.x, p.y, p.z) - X_end.translation).norm();
        at_muscle = std::abs(off - scene_.looks[0].muscle_radius) < 1e-3;
      }
      if (m.ns == "pressures" && m.id == 0) {
        tells = m.text.find("muscle_1  300 kPa") != std::string::npos;
      }
    }
    return at_muscle && tells;
  }));
}

}  // namespace
}  // namespace helix_arm::test
