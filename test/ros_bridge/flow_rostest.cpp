// From targets to commands, measurements and the model's shape; and targets that no one should
// obey.
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include <gtest/gtest.h>

#include "helix_arm/control/target_check.hpp"
#include "helix_arm/model/curve.hpp"
#include "support/vision_rig.hpp"

namespace helix_arm::test {
namespace {

using control::Fault;

constexpr char kTargets[] = "pressure_command: targets";

Eigen::VectorXd clamped(const model::Arm& arm, const std::vector<double>& pressure) {
  return arm.clamped(vectorOf(pressure));
}

class Flow : public ::testing::Test {
 protected:
  explicit Flow(const std::string& scene = "spatial_50", const std::string& ns = "")
      : scene_(shippedScene(scene)), rig_(ns) {}

  void SetUp() override { ASSERT_TRUE(rig_.connect()); }

  // A model message and the pressures of its measurement, inside the limits.
  std::pair<ArmShape::ConstPtr, Eigen::VectorXd> pair() {
    PressureArray::ConstPtr measured;
    const auto model = rig_.model.next([&](const ArmShape& shape) {
      for (const auto& m : rig_.measured.all()) {
        if (m->header.stamp == shape.header.stamp) measured = m;
      }
      return measured != nullptr;
    });
    return {model, measured ? clamped(scene_.arm, measured->pressure) : Eigen::VectorXd()};
  }

  // Sends a target that must be reached. @return the pressures that it comes to.
  template <class Target>
  Eigen::VectorXd reach(const Target& target) {
    const TargetStatus answer = rig_.send(target);
    EXPECT_EQ(answer.outcome, TargetStatus::REACHED) << answer.message;
    EXPECT_LE(answer.position_error, 1e-6);
    return vectorOf(rig_.commandAfter(answer));
  }

  const io::Scene scene_;
  Rig rig_;
};

TipTarget positionOf(const lie::SE3& tip) {
  TipTarget target;
  target.pose.position = ros_bridge::toPointMsg(tip.translation);
  return target;
}

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
  // Names left out keep their command.
  const TargetStatus partial = rig_.sendPressures({3e4}, {"muscle_3"});
  EXPECT_EQ(partial.outcome, TargetStatus::REACHED);
  EXPECT_EQ(rig_.commandAfter(partial), (std::vector<double>{1e5, 2e5, 3e4}));
}

TEST_F(Flow, MeasuredPressuresReachTheCommandWithinTheirNoise) {
  const Eigen::Vector3d wanted(2.5e5, 1e4, 1.2e5);
  rig_.keepOn();
  rig_.sendPressures({wanted.begin(), wanted.end()});
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
    const auto [model, pressure] = pair();
    ASSERT_TRUE(model);
    EXPECT_EQ(model->header.frame_id, "arm_base");
    EXPECT_EQ(model->tier, "linear");
    ASSERT_EQ(model->sections, 1U);
    const auto twists = scene_.arm.twists(pressure);
    EXPECT_LT((vectorOf(model->twist) - Eigen::VectorXd(twists.col(0))).norm(), 1e-14);
    const lie::SE3 tip = ros_bridge::fromMsg(model->tip), expected = model::tipPose(twists);
    EXPECT_LT((tip.translation - expected.translation).norm(), 1e-14);
    EXPECT_LT((tip.rotation - expected.rotation).norm(), 1e-14);
  }
}

TEST_F(Flow, TipsAndShapesAreReached) {
  const lie::SE3 place = scene_.arm.tip(Eigen::Vector3d(2e5, 5e4, 1e5));
  TipTarget target = positionOf(place);
  target.header.frame_id = "arm_base";
  EXPECT_LT((scene_.arm.tip(reach(target)).translation - place.translation).norm(), 1e-6);

  const lie::SE3 pose = scene_.arm.tip(Eigen::Vector3d(1e5, 2.2e5, 4e4));
  target.mode = TipTarget::POSE;
  target.pose = ros_bridge::toPoseMsg(pose);
  const TargetStatus answer = rig_.send(target);
  EXPECT_EQ(answer.outcome, TargetStatus::REACHED) << answer.message;
  const lie::SE3 tip = scene_.arm.tip(vectorOf(rig_.commandAfter(answer)));
  EXPECT_LT((tip.translation - pose.translation).norm(), 1e-5);
  EXPECT_LT((tip.rotation - pose.rotation).norm(), 1e-4);

  const auto wanted = scene_.arm.twists(Eigen::Vector3d(5e4, 1.5e5, 2.5e5));
  ShapeTarget shape;
  shape.twist.assign(wanted.data(), wanted.data() + wanted.size());
  EXPECT_LT((scene_.arm.twists(reach(shape)) - wanted).norm(), 1e-5);
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
  const std::vector<double> command = rig_.commandAfter(answer);
  EXPECT_EQ(vectorOf(command), clamped(scene_.arm, command));
  // The arm bends towards it.
  EXPECT_GT(scene_.arm.tip(vectorOf(command)).translation.y(), 0.05);
  EXPECT_TRUE(rig_.diagnoses(kTargets, names::kUnreachableKey,
                             [](const std::string& count) { return std::stoi(count) >= 1; }));
}

TEST_F(Flow, DiagnosticsTellRatesAndWhoCommands) {
  rig_.sendPressures({1e5, 1e5, 1e5});
  EXPECT_TRUE(rig_.diagnostics.next([](const diagnostic_msgs::DiagnosticArray& array) {
    const auto loop = [&](const char* key) {
      return Rig::valueIn(array, "pressure_command: loop", key);
    };
    return Rig::valueIn(array, kTargets, names::kLeaseHolderKey) == ros::this_node::getName() &&
           loop(names::kWantedRateKey) == "100.0" && std::atof(loop(names::kRateKey).c_str()) > 0;
  }));
}

// Each fault is a law of control/; here it is dropped, answered and counted, and the arm stays.
TEST_F(Flow, TargetsThatNoOneShouldObeyAreDropped) {
  using Send = std::function<TargetStatus()>;
  const double nan = std::nan(""), infinity = std::numeric_limits<double>::infinity();
  const std::string endless(2'000'000, '\n'), far(2'000'000, 'x');
  const std::vector<double> held = {1.1e5, 1.2e5, 1.3e5};
  const auto pressures = [this](const std::vector<double>& pressure,
                                const std::vector<std::string>& name = {}) -> Send {
    return [=] { return rig_.sendPressures(pressure, name); };
  };
  const auto shape = [this](const std::vector<double>& twist) -> Send {
    return [=] {
      ShapeTarget target;
      target.twist = twist;
      return rig_.send(target);
    };
  };
  const auto tip = [this](double x, double qx, double qw, int mode = TipTarget::POSE,
                          const std::string& frame = "") -> Send {
    return [=] {
      TipTarget target;
      target.header.frame_id = frame;
      target.mode = static_cast<std::uint8_t>(mode);
      target.pose.position.x = x;
      target.pose.orientation.x = qx;
      target.pose.orientation.w = qw;
      return rig_.send(target);
    };
  };
  const struct {
    Fault fault;
    const char* word;  // of the answer
    Send send;
  } kRows[] = {
      {Fault::kNotFinite, "muscle_2", pressures({0, nan, 0})},
      {Fault::kNotFinite, "muscle_3", pressures({0, 0, infinity})},
      {Fault::kNotFinite, "muscle_1", pressures({-infinity}, {"muscle_1"})},
      {Fault::kNotFinite, "twist[4]", shape({0.4, 0, 0, 0, nan, 0})},
      {Fault::kNotFinite, "the tip's x", tip(nan, 0, 1)},
      {Fault::kNotFinite, "the tip's x", tip(infinity, 0, 0, TipTarget::POSITION)},
      {Fault::kNotFinite, "quaternion", tip(0.3, nan, 1)},
      {Fault::kWrongSize, "0 pressures", pressures({})},
      {Fault::kWrongSize, "2 pressures", pressures({1, 2})},
      {Fault::kWrongSize, "4 pressures", pressures({1, 2, 3, 4})},
      {Fault::kWrongSize, "1 names", pressures({1, 2}, {"muscle_1"})},
      {Fault::kWrongSize, "0 pressures", pressures({}, {"muscle_1"})},
      {Fault::kWrongSize, "0 numbers", shape({})},
      {Fault::kWrongSize, "7 numbers", shape({1, 2, 3, 4, 5, 6, 7})},
      {Fault::kUnknownName, "'muscle_9'", pressures({1}, {"muscle_9"})},
      {Fault::kUnknownName, "????...'", pressures({1}, {endless})},
      {Fault::kDuplicateName, "'muscle_1'", pressures({1, 2}, {"muscle_1", "muscle_1"})},
      {Fault::kOutOfRange, "muscle_1", pressures({-1, 0, 0})},
      {Fault::kOutOfRange, "muscle_2", pressures({9e5}, {"muscle_2"})},
      {Fault::kWrongFrame, "'world'", tip(0.3, 0, 1, TipTarget::POSE, "world")},
      {Fault::kWrongFrame, "'/arm_base'", tip(0.3, 0, 1, TipTarget::POSITION, "/arm_base")},
      {Fault::kWrongFrame, "xxxx...'", tip(0.3, 0, 1, TipTarget::POSE, far)},
      {Fault::kUnknownMode, "mode 2", tip(0.3, 0, 1, 2)},
      {Fault::kNotUnitQuaternion, "norm 0", tip(0.3, 0, 0)},
      {Fault::kNotUnitQuaternion, "norm 1.41", tip(0.3, 1, 1)},
  };
  rig_.keepOn();
  ASSERT_EQ(rig_.sendPressures(held).outcome, TargetStatus::REACHED);
  std::map<Fault, int> sent;
  for (const auto& row : kRows) {
    const TargetStatus answer = row.send();
    EXPECT_EQ(answer.outcome, TargetStatus::DROPPED) << row.word;
    EXPECT_EQ(answer.fault, control::nameOf(row.fault)) << row.word;
    EXPECT_NE(answer.message.find(row.word), std::string::npos) << row.word << answer.message;
    EXPECT_LT(answer.message.size(), 200U);
    EXPECT_EQ(rig_.commandAfter(answer), held) << row.word;
    ++sent[row.fault];
  }
  EXPECT_TRUE(rig_.diagnostics.next([&](const diagnostic_msgs::DiagnosticArray& array) {
    const auto isCounted = [&](const auto& fault) {
      const std::string key = names::kDroppedPrefix + std::string(control::nameOf(fault.first));
      return Rig::valueIn(array, kTargets, key) == std::to_string(fault.second);
    };
    return std::all_of(sent.begin(), sent.end(), isCounted) &&
           !Rig::valueIn(array, kTargets, names::kLastFaultKey).empty();
  }));
  const TargetStatus good = rig_.sendPressures({2e5, 1e5, 0});
  EXPECT_EQ(good.outcome, TargetStatus::REACHED);
  EXPECT_EQ(rig_.commandAfter(good), (std::vector<double>{2e5, 1e5, 0}));
}

class PlanarFlow : public Flow {
 protected:
  PlanarFlow() : Flow("planar_76", "flat") {}
};

TEST_F(PlanarFlow, TheShapeIsThePlanarModelsAndATipInThePlaneIsReached) {
  ASSERT_TRUE(scene_.planar);
  rig_.sendPressures({2e5, 1e4});
  for (int i = 0; i < 20; ++i) {
    const auto [model, pressure] = pair();
    ASSERT_TRUE(model);
    EXPECT_EQ(model->tier, "planar");
    EXPECT_EQ(model->header.frame_id, "flat_arm_base");
    EXPECT_EQ(model->tip.position.z, 0.0);
    const auto twist = model::embed(scene_.planar->twists(pressure));
    EXPECT_LT((vectorOf(model->twist) - Eigen::VectorXd(twist.col(0))).norm(), 1e-14);
  }
  const lie::SE3 wanted = scene_.arm.tip(Eigen::Vector2d(5e4, 2e5));
  const Eigen::VectorXd command = reach(positionOf(wanted));
  EXPECT_LT((scene_.arm.tip(command).translation - wanted.translation).norm(), 1e-6);
}

}  // namespace
}  // namespace helix_arm::test
