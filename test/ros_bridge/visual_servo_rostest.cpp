// The loop over vision as a node: its states, its commanders, and targets in other frames.
#include <csignal>

#include "support/loop_rig.hpp"

namespace helix_arm::test {
namespace {

class VisualServo : public LoopRig {
 protected:
  // Largest change of a pressure between two targets that the loop sent from this one on [Pa].
  double largestStep(std::size_t first) const {
    double out = 0;
    for (std::size_t k = first + 1; k < sent_.all().size(); ++k) {
      out = std::max(out,
                     (vectorOf(sent_.all()[k]->pressure) - vectorOf(sent_.all()[k - 1]->pressure))
                         .cwiseAbs()
                         .maxCoeff());
    }
    return out;
  }
};

TEST_F(VisualServo, ClosesAndBringsTheMeasuredTipToItsTarget) {
  const TipTarget target = targetAt(kMiddle);
  ASSERT_TRUE(comesTo(LoopStatus::CLOSED, target)) << loop_.last().message << vision_->outputNow();
  EXPECT_TRUE(tipComesTo(kMiddle, 0.005, target));
  tip_target_.publish(target);
  const TargetStatus answer = answerOn(names::kTipTarget);
  EXPECT_EQ(answer.outcome, TargetStatus::REACHED) << answer.message;
  EXPECT_LT(answer.position_error, 1e-5);
  const LoopStatus& status = loop_.last();
  EXPECT_EQ(status.commander, ros::this_node::getName());
  EXPECT_EQ(status.inverse, "reached");
  EXPECT_LT((tipOf(status.wanted) - kMiddle).norm(), 1e-12);
  EXPECT_LT((tipOf(status.predicted) - tipOf(eye_.measured.last().tip)).norm(), 0.01);
  EXPECT_GT(status.accepted, 2U);
  EXPECT_GT(status.predicted_sd, 0);
  EXPECT_LT(status.predicted_sd, 0.01);
  EXPECT_TRUE(std::isnan(status.path_time));
}

TEST_F(VisualServo, TellsItsEstimateAndDrawsItsErrorBudget) {
  const auto estimate = estimate_.next([](const ArmShape&) { return true; });
  ASSERT_TRUE(estimate);
  EXPECT_EQ(estimate->tier, "estimated");
  EXPECT_EQ(estimate->header.frame_id, "arm_base");
  ASSERT_EQ(estimate->twist_covariance.size(), 36U);
  const Eigen::Map<const Eigen::MatrixXd> covariance(estimate->twist_covariance.data(), 6, 6);
  EXPECT_GT(covariance.diagonal().minCoeff(), 0);
  EXPECT_LT((covariance - covariance.transpose()).norm(), 1e-12 * covariance.norm());
  Inbox<visualization_msgs::MarkerArray> markers(node_, names::kLoopMarkers);
  EXPECT_TRUE(markers.next([](const visualization_msgs::MarkerArray& array) {
    return std::any_of(array.markers.begin(), array.markers.end(), [](const auto& marker) {
      return marker.ns == names::kErrorBudgetNs &&
             marker.text.find(" mm placement\n") != std::string::npos;
    });
  }));
}

// Else it would take those that face the camera for those in sight.
TEST_F(VisualServo, TheTagsOfEachFitReachIt) {
  const auto countsNow = [this] {
    std::array<double, 2> out = {-1, -1};
    for (const auto& array : diagnostics_.all()) {
      for (const auto& status : array->status) {
        if (status.name != "visual_servo: loop") continue;
        for (const auto& value : status.values) {
          if (value.key == names::kAcceptedKey) out[0] = std::stod(value.value);
          if (value.key == names::kWithoutTagsKey) out[1] = std::stod(value.value);
        }
      }
    }
    return out;
  };
  ASSERT_TRUE(waitFor([&] { return countsNow()[0] > 0; }));
  const auto [accepted, without] = countsNow();
  ASSERT_TRUE(waitFor([&, before = accepted] { return countsNow()[0] >= before + 20; }, 60));
  EXPECT_LT(countsNow()[1], without + 10);
}

TEST_F(VisualServo, WhoeverFallsSilentLetsGoOfTheArm) {
  ASSERT_TRUE(comesTo(LoopStatus::CLOSED, targetAt(kMiddle)));
  ASSERT_TRUE(comesTo(LoopStatus::IDLE));
  EXPECT_EQ(loop_.last().message, "the loop has no target");
  EXPECT_FALSE(loop_.last().has_wanted);
  const std::size_t sent = sent_.all().size();
  EXPECT_TRUE(waitFor([this] { return safety_.last().cause == "stale_target"; }));
  EXPECT_EQ(sent_.all().size(), sent) << "it goes on commanding";
}

TEST_F(VisualServo, TargetsMayBeSeenFromAnyFrameThatTfRelatesToTheBase) {
  const lie::SE3 X_WB = shippedScene("demo").X_WB;
  geometry_msgs::PoseStamped pose;
  pose.header.frame_id = names::kWorldFrame;
  pose.pose.position = ros_bridge::toPointMsg(X_WB * kMiddle);
  ASSERT_TRUE(waitFor([&] {
    pose.header.stamp = ros::Time::now();
    tip_pose_.publish(pose);
    return waitFor([this] { return loop_.last().has_wanted; }, 0.1);
  })) << loop_.last().message;
  EXPECT_LT((tipOf(loop_.last().wanted) - kMiddle).norm(), 1e-6);
  pose.header.stamp = ros::Time::now();
  tip_pose_.publish(pose);
  EXPECT_EQ(answerOn(names::kTipPose).outcome, TargetStatus::REACHED);
  // With an orientation it is a pose, and the closest shape keeps some of both.
  pose.pose.orientation.w = 1;
  tip_pose_.publish(pose);
  EXPECT_EQ(answerOn(names::kTipPose).outcome, TargetStatus::UNREACHABLE);
}

TEST_F(VisualServo, FramesThatTfDoesNotKnowAreRefused) {
  tip_target_.publish(targetAt(kMiddle, "nowhere"));
  const TargetStatus answer = answerOn(names::kTipTarget);
  EXPECT_EQ(answer.outcome, TargetStatus::DROPPED);
  EXPECT_EQ(answer.fault, "wrong_frame");
  for (const char* words : {"'nowhere'", "'arm_base'"}) {
    EXPECT_NE(answer.message.find(words), std::string::npos) << answer.message;
  }
  EXPECT_EQ(loop_.last().state, LoopStatus::IDLE);
}

TEST_F(VisualServo, StaysOpenWhereItIsToldToAndForgetsWhatItLearntWhenReset) {
  const TipTarget target = targetAt(kMiddle);
  ASSERT_TRUE(comesTo(LoopStatus::CLOSED, target));
  ASSERT_TRUE(closeLoop(false));
  EXPECT_TRUE(comesTo(LoopStatus::OPEN, target));
  EXPECT_EQ(loop_.last().message, "kept open by ~close_loop");
  ASSERT_TRUE(closeLoop(true));
  ASSERT_TRUE(comesTo(LoopStatus::CLOSED, target));
  ASSERT_TRUE(tipComesTo(kMiddle, 0.003, target));
  const std::size_t before = loop_.all().size();
  ASSERT_TRUE(call("visual_servo/reset"));
  ASSERT_TRUE(comesTo(LoopStatus::CLOSED, target));
  const bool opened = std::any_of(
      loop_.all().begin() + static_cast<std::ptrdiff_t>(before), loop_.all().end(),
      [](const LoopStatus::ConstPtr& status) { return status->state != LoopStatus::CLOSED; });
  EXPECT_TRUE(opened || waitFor([&] {
                repeat(target);
                return loop_.last().state != LoopStatus::CLOSED;
              }))
      << "three pictures must close it again";
  EXPECT_TRUE(tipComesTo(kMiddle, 0.003, target));
}

TEST_F(VisualServo, WithoutPicturesOrWithThoseOfAnotherClockItCoastsAndIsOpenAtLastWithoutAJump) {
  const TipTarget target = targetAt(kMiddle);
  ASSERT_TRUE(comesTo(LoopStatus::CLOSED, target));
  ASSERT_TRUE(tipComesTo(kMiddle, 0.002, target));
  const std::size_t first = sent_.all().size();
  vision_->signal(SIGKILL);
  EXPECT_TRUE(comesTo(LoopStatus::COASTING, target));
  // As from a computer with another clock: nothing is used, and the message names the clocks.
  ros::Publisher measured = node_.advertise<ArmShape>(names::kMeasured, 10);
  ArmShape seen = eye_.measured.last();
  const struct {
    double ahead;  // of the clock [s]
    const char* fault;
  } clocks[] = {{1.0, "(future)"}, {-1.2, "(too_old)"}};
  for (const auto& clock : clocks) {
    EXPECT_TRUE(waitFor(
        [&] {
          repeat(target);
          seen.header.stamp = ros::Time::now() + ros::Duration(clock.ahead);
          measured.publish(seen);
          const LoopStatus& told = loop_.last();
          return (told.state == LoopStatus::COASTING || told.state == LoopStatus::OPEN) &&
                 told.message.find(clock.fault) != std::string::npos &&
                 told.message.find("synchronise the clocks") != std::string::npos;
        },
        40))
        << clock.fault << ": " << loop_.last().state << ", " << loop_.last().message;
  }
  EXPECT_TRUE(comesTo(LoopStatus::OPEN, target));
  EXPECT_LT((tipOf(loop_.last().predicted) - kMiddle).norm(), 0.005) << "it keeps what it learnt";
  startVision();
  EXPECT_TRUE(comesTo(LoopStatus::CLOSED, target)) << vision_->outputNow();
  EXPECT_LT(largestStep(first), 2e4);
  EXPECT_EQ(safety_.last().state, SafetyState::ENABLED);
}

}  // namespace
}  // namespace helix_arm::test
