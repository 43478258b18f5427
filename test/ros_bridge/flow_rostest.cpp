// From targets to commands, measurements and the model's shape.
#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/curve.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "support/ros_rig.hpp"

namespace helix_arm::test {
namespace {

io::Scene shipped(const std::string& name) {
  return io::loadScene(HELIX_ARM_SOURCE_DIR "/config/scenes/" + name + ".yaml");
}

Eigen::VectorXd vectorOf(const std::vector<double>& values) {
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

std::vector<double> listOf(const Eigen::VectorXd& values) { return {values.begin(), values.end()}; }

Eigen::VectorXd clamped(const model::Arm& arm, Eigen::VectorXd q) {
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    q[i] = std::clamp(q[i], arm.actuator(i).limits.lower, arm.actuator(i).limits.upper);
  }
  return q;
}

class Flow : public ::testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(rig_.connect()); }

  // A model message and the measurement it was made of.
  std::pair<ArmShape::ConstPtr, PressureArray::ConstPtr> pair() {
    PressureArray::ConstPtr measured;
    const auto model = rig_.model.next([&](const ArmShape& shape) {
      for (const auto& m : rig_.measured.all()) {
        if (m->header.stamp == shape.header.stamp) measured = m;
      }
      return measured != nullptr;
    });
    return {model, measured};
  }

  const io::Scene scene_ = shipped("spatial_50");
  Rig rig_;
};

TEST_F(Flow, APressureTargetBecomesTheCommandAtOnce) {
  const std::vector<double> wanted = {1e5, 2e5, 5e4};
  const TargetStatus answer = rig_.sendPressures(wanted);
  EXPECT_EQ(answer.outcome, TargetStatus::REACHED);
  EXPECT_EQ(answer.topic, names::kPressureTarget);
  EXPECT_EQ(answer.commander, ros::this_node::getName());
  const auto command =
      rig_.command.next([&](const PressureArray& c) { return c.pressure == wanted; });
  ASSERT_TRUE(command);
  EXPECT_EQ(command->name, (std::vector<std::string>{"muscle_1", "muscle_2", "muscle_3"}));
}

TEST_F(Flow, NamesLeftOutKeepTheirCommand) {
  rig_.sendPressures({1e5, 2e5, 5e4});
  const TargetStatus answer = rig_.sendPressures({3e4}, {"muscle_3"});
  EXPECT_EQ(answer.outcome, TargetStatus::REACHED);
  EXPECT_EQ(rig_.commandAfter(answer), (std::vector<double>{1e5, 2e5, 3e4}));
}

TEST_F(Flow, MeasuredPressuresReachTheCommandWithinTheirNoise) {
  const Eigen::Vector3d wanted(2.5e5, 1e4, 1.2e5);
  rig_.keepOn();
  rig_.sendPressures(listOf(wanted));
  // The mean of 50 readings of 5 kPa noise lies within 4 kPa of the truth, but once in 1e7.
  std::vector<Eigen::Vector3d> window;
  EXPECT_TRUE(rig_.measured.next([&](const PressureArray& m) {
    window.emplace_back(vectorOf(m.pressure));
    if (window.size() < 50) return false;
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (auto i = window.end() - 50; i != window.end(); ++i) mean += *i / 50;
    return (mean - wanted).cwiseAbs().maxCoeff() < 4e3;
  }));
}

TEST_F(Flow, TheModelIsTheShapeOfTheMeasuredPressures) {
  rig_.sendPressures({3e5, 1e4, 1.2e5});
  for (int i = 0; i < 20; ++i) {
    const auto [model, measured] = pair();
    ASSERT_TRUE(model && measured);
    EXPECT_EQ(model->header.frame_id, "arm_base");
    EXPECT_EQ(model->tier, "linear");
    ASSERT_EQ(model->sections, 1U);
    const auto twists = scene_.arm.twists(clamped(scene_.arm, vectorOf(measured->pressure)));
    EXPECT_LT((vectorOf(model->twist) - Eigen::VectorXd(twists.col(0))).norm(), 1e-14);
    const lie::SE3 tip = ros_bridge::fromMsg(model->tip), expected = model::tipPose(twists);
    EXPECT_LT((tip.translation - expected.translation).norm(), 1e-14);
    EXPECT_LT((tip.rotation - expected.rotation).norm(), 1e-14);
  }
}

TEST_F(Flow, ATipPositionIsReached) {
  const Eigen::Vector3d wanted = scene_.arm.tip(Eigen::Vector3d(2e5, 5e4, 1e5)).translation;
  TipTarget target;
  target.header.frame_id = "arm_base";
  target.pose.position = ros_bridge::toPointMsg(wanted);
  const TargetStatus answer = rig_.send(target);
  EXPECT_EQ(answer.outcome, TargetStatus::REACHED) << answer.message;
  EXPECT_LE(answer.position_error, 1e-6);
  const Eigen::VectorXd command = vectorOf(rig_.commandAfter(answer));
  EXPECT_LT((scene_.arm.tip(command).translation - wanted).norm(), 1e-6);
}

TEST_F(Flow, ATipPoseIsReached) {
  const lie::SE3 wanted = scene_.arm.tip(Eigen::Vector3d(1e5, 2.2e5, 4e4));
  TipTarget target;
  target.mode = TipTarget::POSE;
  target.pose = ros_bridge::toPoseMsg(wanted);
  const TargetStatus answer = rig_.send(target);
  EXPECT_EQ(answer.outcome, TargetStatus::REACHED) << answer.message;
  const lie::SE3 tip = scene_.arm.tip(vectorOf(rig_.commandAfter(answer)));
  EXPECT_LT((tip.translation - wanted.translation).norm(), 1e-5);
  EXPECT_LT((tip.rotation - wanted.rotation).norm(), 1e-4);
}

TEST_F(Flow, AShapeIsReached) {
  const auto wanted = scene_.arm.twists(Eigen::Vector3d(5e4, 1.5e5, 2.5e5));
  ShapeTarget target;
  target.twist.assign(wanted.data(), wanted.data() + wanted.size());
  const TargetStatus answer = rig_.send(target);
  EXPECT_EQ(answer.outcome, TargetStatus::REACHED) << answer.message;
  const auto twists = scene_.arm.twists(vectorOf(rig_.commandAfter(answer)));
  EXPECT_LT((twists - wanted).norm(), 1e-5);
}

TEST_F(Flow, ATargetOutOfReachMovesTheArmToTheClosestAndSaysSo) {
  TipTarget target;
  target.pose.position.x = 0.3;
  target.pose.position.y = 2.0;
  const TargetStatus answer = rig_.send(target);
  EXPECT_EQ(answer.outcome, TargetStatus::UNREACHABLE);
  EXPECT_FALSE(answer.message.empty());
  EXPECT_GT(answer.position_error, 1.5);
  EXPECT_FALSE(answer.at_lower_limit.empty() && answer.at_upper_limit.empty());
  const Eigen::VectorXd command = vectorOf(rig_.commandAfter(answer));
  EXPECT_EQ(command, clamped(scene_.arm, command));
  // The arm bends towards it.
  EXPECT_GT(scene_.arm.tip(command).translation.y(), 0.05);
  EXPECT_TRUE(rig_.diagnoses("pressure_command: targets", names::kUnreachableKey,
                             [](const std::string& count) { return std::stoi(count) >= 1; }));
}

TEST_F(Flow, DiagnosticsTellRatesAndWhoCommands) {
  rig_.sendPressures({1e5, 1e5, 1e5});
  EXPECT_TRUE(rig_.diagnoses("pressure_command: targets", names::kLeaseHolderKey,
                             ros::this_node::getName()));
  EXPECT_TRUE(rig_.diagnoses("pressure_command: loop", names::kWantedRateKey, "100.0"));
  EXPECT_TRUE(rig_.diagnoses("pressure_command: loop", names::kRateKey,
                             [](const std::string& rate) { return std::stod(rate) > 0; }));
}

class PlanarFlow : public ::testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(rig_.connect()); }

  const io::Scene scene_ = shipped("planar_76");
  Rig rig_{"flat"};
};

TEST_F(PlanarFlow, TheShapeIsThePlanarModels) {
  ASSERT_TRUE(scene_.planar);
  rig_.sendPressures({2e5, 1e4});
  for (int i = 0; i < 20; ++i) {
    PressureArray::ConstPtr measured;
    const auto model = rig_.model.next([&](const ArmShape& shape) {
      for (const auto& m : rig_.measured.all()) {
        if (m->header.stamp == shape.header.stamp) measured = m;
      }
      return measured != nullptr;
    });
    ASSERT_TRUE(model && measured);
    EXPECT_EQ(model->tier, "planar");
    EXPECT_EQ(model->header.frame_id, "flat_arm_base");
    EXPECT_EQ(model->tip.position.z, 0.0);
    const auto twist =
        model::embed(scene_.planar->twists(clamped(scene_.arm, vectorOf(measured->pressure))));
    EXPECT_LT((vectorOf(model->twist) - Eigen::VectorXd(twist.col(0))).norm(), 1e-14);
  }
}

TEST_F(PlanarFlow, ATipInThePlaneIsReached) {
  const Eigen::Vector3d wanted = scene_.arm.tip(Eigen::Vector2d(5e4, 2e5)).translation;
  TipTarget target;
  target.pose.position = ros_bridge::toPointMsg(wanted);
  const TargetStatus answer = rig_.send(target);
  EXPECT_EQ(answer.outcome, TargetStatus::REACHED) << answer.message;
  EXPECT_LT((scene_.arm.tip(vectorOf(rig_.commandAfter(answer))).translation - wanted).norm(),
            1e-6);
}

}  // namespace
}  // namespace helix_arm::test

int main(int argc, char** argv) { return helix_arm::test::runRostest(argc, argv); }
