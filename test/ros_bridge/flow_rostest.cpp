// From targets to commands, measurements, the model's shape and what rviz gets of it; targets that
// no one should obey; and two commanders.
#include <tf2_msgs/TFMessage.h>
#include <visualization_msgs/InteractiveMarkerFeedback.h>
#include <visualization_msgs/InteractiveMarkerInit.h>

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
  EXPECT_TRUE(rig_.diagnoses(kTargets, "unreachable",
                             [](const std::string& count) { return std::stoi(count) >= 1; }));
}

TEST_F(Flow, DiagnosticsTellRatesAndWhoCommands) {
  rig_.sendPressures({1e5, 1e5, 1e5});
  EXPECT_TRUE(rig_.diagnostics.next([](const diagnostic_msgs::DiagnosticArray& array) {
    const auto loop = [&](const char* key) {
      return Rig::valueIn(array, "pressure_command: loop", key);
    };
    return Rig::valueIn(array, kTargets, "lease_holder") == ros::this_node::getName() &&
           loop("wanted_rate_hz") == "100.0" && std::atof(loop("rate_hz").c_str()) > 0;
  }));
}

// Each fault is a law of control/ or of the conversions; here one of each topic is dropped,
// answered and counted, and the arm stays.
TEST_F(Flow, TargetsThatNoOneShouldObeyAreDropped) {
  const std::vector<double> held = {1.1e5, 1.2e5, 1.3e5};
  TipTarget far, unknown;
  far.header.frame_id = std::string(2'000'000, 'x');
  unknown.mode = 2;
  const struct {
    Fault fault;
    const char* word;  // of the answer
    std::function<TargetStatus()> send;
  } kRows[] = {
      {Fault::kNotFinite, "muscle_2",
       [&] {
         return rig_.sendPressures({0, std::nan(""), 0});
       }},
      {Fault::kUnknownName, "????...'",
       [&] { return rig_.sendPressures({1}, {std::string(2'000'000, '\n')}); }},
      {Fault::kWrongSize, "0 numbers", [&] { return rig_.send(ShapeTarget()); }},
      {Fault::kWrongFrame, "xxxx...'", [&] { return rig_.send(far); }},
      {Fault::kUnknownMode, "mode 2", [&] { return rig_.send(unknown); }},
  };
  rig_.keepOn();
  ASSERT_EQ(rig_.sendPressures(held).outcome, TargetStatus::REACHED);
  for (const auto& row : kRows) {
    const TargetStatus answer = row.send();
    EXPECT_EQ(answer.outcome, TargetStatus::DROPPED) << row.word;
    EXPECT_EQ(answer.fault, control::nameOf(row.fault)) << row.word;
    EXPECT_TRUE(has(answer.message, row.word));
    EXPECT_LT(answer.message.size(), 200U);
    EXPECT_EQ(rig_.commandAfter(answer), held) << row.word;
  }
  EXPECT_TRUE(rig_.diagnostics.next([&](const diagnostic_msgs::DiagnosticArray& array) {
    return !Rig::valueIn(array, kTargets, names::kLastFaultKey).empty() &&
           std::all_of(std::begin(kRows), std::end(kRows), [&](const auto& row) {
             const std::string key = "dropped_" + std::string(control::nameOf(row.fault));
             return Rig::valueIn(array, kTargets, key) == "1";
           });
  }));
  const TargetStatus good = rig_.sendPressures({2e5, 1e5, 0});
  EXPECT_EQ(good.outcome, TargetStatus::REACHED);
  EXPECT_EQ(rig_.commandAfter(good), (std::vector<double>{2e5, 1e5, 0}));
}

lie::SE3 poseOf(const geometry_msgs::Transform& t) {
  const Eigen::Quaterniond q(t.rotation.w, t.rotation.x, t.rotation.y, t.rotation.z);
  return {q.toRotationMatrix(), {t.translation.x, t.translation.y, t.translation.z}};
}

double distance(const lie::SE3& a, const lie::SE3& b) {
  return (a.translation - b.translation).norm() + (a.rotation - b.rotation).norm();
}

TEST_F(Flow, FramesLieOnTheModelOfTheSameStampAndTheMarkersAreDrawn) {
  constexpr int kFrames = 9;  // as in flow.test
  ros::NodeHandle node;
  Inbox<tf2_msgs::TFMessage> tf(node, names::kTf), static_tf(node, names::kStaticTf);
  Inbox<visualization_msgs::MarkerArray> markers(node, names::kMarkers);
  rig_.keepOn();
  ASSERT_EQ(rig_.sendPressures({3e5, 0, 1e5}).outcome, TargetStatus::REACHED);
  ASSERT_TRUE(waitFor([&] { return !markers.all().empty() && static_tf.all().size() >= 2; }));
  // The other arm's have a prefix.
  std::map<std::string, geometry_msgs::TransformStamped> placed;
  for (const auto& message : static_tf.all()) {
    for (const auto& t : message->transforms) placed[t.child_frame_id] = t;
  }
  ASSERT_EQ(placed.count("arm_base"), 1U);
  EXPECT_EQ(placed["arm_base"].header.frame_id, "world");
  EXPECT_LT(distance(poseOf(placed["arm_base"].transform), scene_.X_WB), 1e-12);
  EXPECT_EQ(placed.size(), 2U);
  for (int i = 0; i < 10; ++i) {
    ArmShape::ConstPtr model;
    const auto moving = tf.next([&](const tf2_msgs::TFMessage& message) {
      for (const auto& m : rig_.model.all()) {
        const auto& first = message.transforms.at(0);
        if (first.header.stamp == m->header.stamp && first.header.frame_id == "arm_base") model = m;
      }
      return model != nullptr;
    });
    ASSERT_TRUE(moving && model);
    const model::Twists twists = Eigen::Map<const model::Twists>(model->twist.data(), 6, 1);
    std::map<std::string, lie::SE3> X;
    for (const auto& t : moving->transforms) {
      EXPECT_EQ(t.header.frame_id, "arm_base");
      X[t.child_frame_id] = poseOf(t.transform);
    }
    ASSERT_EQ(X.size(), kFrames + 1U);
    for (int k = 0; k < kFrames; ++k) {
      const double s = 1.0 * k / (kFrames - 1);
      EXPECT_LT(distance(X.at("model_" + std::to_string(k)), model::poseAt(twists, s)), 1e-12);
    }
    EXPECT_LT(distance(X.at("model_tip"), ros_bridge::fromMsg(model->tip)), 1e-12);
  }
}

// The test's own node and the interactive marker, which is dragged to where the arm's tip is at
// some pressures.
TEST_F(Flow, OfTwoCommandersTheFirstHoldsTheLeaseUntilItIsSilent) {
  using Feedback = visualization_msgs::InteractiveMarkerFeedback;
  ros::NodeHandle node(names::kTipHandle);
  const ros::Publisher publisher = node.advertise<Feedback>("feedback", 10);
  const Inbox<visualization_msgs::InteractiveMarkerInit> handle(node, "update_full");
  ASSERT_TRUE(waitFor([&] { return publisher.getNumSubscribers() > 0 && !handle.all().empty(); }));
  const auto drag = [&](const Eigen::Vector3d& pressure) {
    Feedback feedback;
    feedback.header.frame_id = "arm_base";
    feedback.marker_name = handle.last().markers.at(0).name;
    feedback.client_id = "test";
    feedback.event_type = Feedback::POSE_UPDATE;
    feedback.pose = ros_bridge::toPoseMsg(scene_.arm.tip(pressure));
    publisher.publish(feedback);
    const auto answer = rig_.status.next(
        [](const TargetStatus& s) { return s.commander == names::kInteractiveMarker; });
    return answer ? *answer : TargetStatus();
  };
  const std::vector<double> held(3, 1e5);
  rig_.keepOn();
  TargetStatus answer;
  // A busy machine may hold up the first for so long that it loses the lease.
  ASSERT_TRUE(waitFor([&] {
    if (rig_.sendPressures(held).outcome != TargetStatus::REACHED) return false;
    answer = drag({2e5, 1e5, 5e4});
    return answer.outcome == TargetStatus::DROPPED && rig_.commandAfter(answer) == held;
  }));
  EXPECT_EQ(answer.fault, "other_commander");
  EXPECT_TRUE(has(answer.message, ros::this_node::getName()));
  EXPECT_TRUE(rig_.diagnoses(kTargets, "dropped_other_commander",
                             [](const std::string& count) { return std::stoi(count) >= 1; }));
  EXPECT_TRUE(rig_.diagnoses(kTargets, "lease_holder", ros::this_node::getName()));
  rig_.fallSilent();
  ASSERT_TRUE(waitFor([&] {
    answer = drag({2e5, 1e5, 5e4});
    return answer.outcome == TargetStatus::REACHED;
  }));
  EXPECT_LE(answer.position_error, 1e-6);
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
