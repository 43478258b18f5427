// Two commanders of one arm: the test's own node and the interactive marker.
#include <visualization_msgs/InteractiveMarkerFeedback.h>
#include <visualization_msgs/InteractiveMarkerInit.h>

#include "helix_arm/io/scene.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "support/ros_rig.hpp"

namespace helix_arm::test {
namespace {

using Feedback = visualization_msgs::InteractiveMarkerFeedback;

const std::vector<double> kPressures(7, 1e5);  // [Pa]

class Commanders : public ::testing::TestWithParam<std::string> {
 protected:
  Commanders()
      : rig_(GetParam()),
        node_(GetParam()),
        feedback_(node_.advertise<Feedback>(names::kTipHandle + std::string("/feedback"), 10)),
        handle_(node_, names::kTipHandle + std::string("/update_full")) {}

  void SetUp() override {
    ASSERT_TRUE(rig_.connect());
    ASSERT_TRUE(waitFor([this] { return feedback_.getNumSubscribers() > 0; }));
    ASSERT_TRUE(waitFor([this] { return !handle_.all().empty(); }));
  }

  // Drags the handle to where the arm's tip is at these pressures, and returns the node's answer to
  // it.
  TargetStatus drag(const std::vector<double>& pressures) {
    const io::Scene scene =
        io::loadScene(HELIX_ARM_SOURCE_DIR "/test/ros_bridge/scenes/" + GetParam() + ".yaml");
    const Eigen::Map<const Eigen::VectorXd> q(pressures.data(), 7);
    Feedback feedback;
    feedback.header.frame_id = GetParam() + "_arm_base";
    feedback.marker_name = handle_.last().markers.at(0).name;
    feedback.client_id = "test";
    feedback.event_type = Feedback::POSE_UPDATE;
    feedback.pose = ros_bridge::toPoseMsg(scene.arm.tip(q));
    feedback_.publish(feedback);
    const auto answer = rig_.status.next(
        [](const TargetStatus& s) { return s.commander == names::kInteractiveMarker; });
    return answer ? *answer : TargetStatus();
  }

  std::string statusName() const { return GetParam() + "/pressure_command: targets"; }

  Rig rig_;
  ros::NodeHandle node_;
  ros::Publisher feedback_;
  Inbox<visualization_msgs::InteractiveMarkerInit> handle_;
};

using Patient = Commanders;

TEST_P(Patient, TheNewerIsRefusedWhileTheFirstHoldsTheLease) {
  rig_.keepOn();
  ASSERT_EQ(rig_.sendPressures(kPressures).outcome, TargetStatus::REACHED);
  const TargetStatus answer = drag(std::vector<double>(7, 2e5));
  EXPECT_EQ(answer.outcome, TargetStatus::DROPPED);
  EXPECT_EQ(answer.fault, "other_commander");
  EXPECT_NE(answer.message.find(ros::this_node::getName()), std::string::npos) << answer.message;
  EXPECT_EQ(rig_.commandAfter(answer), kPressures);
  EXPECT_TRUE(rig_.diagnoses(statusName(), "dropped_other_commander", "1"));
  EXPECT_TRUE(rig_.diagnoses(statusName(), "lease_holder", ros::this_node::getName()));
}

INSTANTIATE_TEST_SUITE_P(, Patient, ::testing::Values("patient"));

class Brisk : public Commanders {};

TEST_P(Brisk, TheNewerTakesOverOnceTheFirstIsSilent) {
  ASSERT_EQ(rig_.sendPressures(kPressures).outcome, TargetStatus::REACHED);
  TargetStatus answer;
  ASSERT_TRUE(waitFor([&] {
    answer = drag({1e5, 2e5, 0, 1e5, 0, 2e5, 0});
    return answer.outcome == TargetStatus::REACHED;
  }));
  EXPECT_EQ(answer.commander, names::kInteractiveMarker);
  EXPECT_LE(answer.position_error, 1e-6);
}

INSTANTIATE_TEST_SUITE_P(, Brisk, ::testing::Values("brisk"));

}  // namespace
}  // namespace helix_arm::test
