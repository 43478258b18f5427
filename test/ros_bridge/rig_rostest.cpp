// The whole loop: pressures -> true arm -> pictures -> tags -> measured shape beside the model.
#include <csignal>

#include <tf2_msgs/TFMessage.h>

#include "helix_arm/simulation/rig.hpp"
#include "support/process.hpp"
#include "support/vision_rig.hpp"

namespace helix_arm::test {
namespace {

using visualization_msgs::Marker;

constexpr char kLoop[] = "pressure_command: loop";

class Loop : public ::testing::Test {
 protected:
  void SetUp() override {
    start();
    ASSERT_TRUE(rig_.connect());
    ASSERT_TRUE(waitFor([this] {
      return !truth_.all().empty() && !image_.all().empty() && !info_.all().empty() &&
             !eye_.measured.all().empty() && !eye_.errors.all().empty() && !tf_.all().empty();
    })) << rig_process_->output();
    ASSERT_TRUE(eye_.measured.next([](const ArmShape&) { return true; })) << rig_process_->output();
  }

  void start() {
    rig_process_ = std::make_unique<Process>(
        std::vector<std::string>{HELIX_ARM_SIMULATED_RIG, "_scene:=demo", "_camera_rate:=8"});
  }

  Rig rig_;
  VisionListener eye_{""};
  Inbox<ArmShape> truth_{eye_.node, names::kTruth};
  Inbox<sensor_msgs::Image> image_{eye_.node, names::kImage};
  Inbox<sensor_msgs::CameraInfo> info_{eye_.node, names::kCameraInfo};
  Inbox<tf2_msgs::TFMessage> tf_{eye_.node, "/tf"};
  std::unique_ptr<Process> rig_process_;
};

Eigen::Vector3d tipOf(const ArmShape& shape) { return ros_bridge::fromMsg(shape.tip).translation; }

TEST_F(Loop, MeasuredIsTheTrueShapeAtTheTimeOfThePicture) {
  rig_.keepOn();
  for (const std::vector<double>& pressure : {std::vector<double>{2.5e5, 1e5, 0}, {0, 1e5, 3e5}}) {
    ASSERT_EQ(rig_.sendPressures(pressure).outcome, TargetStatus::REACHED);
    for (int k = 0; k < 12; ++k) {
      const auto measured = eye_.measured.next([](const ArmShape&) { return true; });
      ASSERT_TRUE(measured);
      const auto truth = VisionListener::of(truth_, measured->header.stamp);
      ASSERT_TRUE(truth);
      EXPECT_TRUE(VisionListener::of(info_, measured->header.stamp));
      EXPECT_EQ(truth->tier, "truth");
      EXPECT_LT((tipOf(*measured) - tipOf(*truth)).norm(), 0.005);
    }
  }
}

TEST_F(Loop, ModelAndErrorAndFramesAreOfTheSameTime) {
  const auto error = eye_.errors.next([](const ModelError&) { return true; });
  ASSERT_TRUE(error);
  EXPECT_EQ(error->header.frame_id, "arm_base");
  const auto measured = VisionListener::of(eye_.measured, error->header.stamp);
  ASSERT_TRUE(measured && VisionListener::of(rig_.model, error->model_stamp));
  // The rig stamps both alike; on a busy machine the model may come too late to be waited for.
  EXPECT_LT(std::abs((error->model_stamp - error->header.stamp).toSec()), 0.05);
  // Both hang from the nominal base; measured is seen from the one that was fitted, measured_0.
  ASSERT_TRUE(waitFor([&] {
    std::map<std::string, Eigen::Vector3d> places;
    for (const auto& message : tf_.all()) {
      for (const auto& t : message->transforms) {
        if (t.header.stamp != error->header.stamp || t.header.frame_id != "arm_base") continue;
        const auto& p = t.transform.translation;
        places[t.child_frame_id] = {p.x, p.y, p.z};
      }
    }
    if (places.count("measured_0") == 0 || places.count("measured_tip") == 0) return false;
    EXPECT_NEAR((places["measured_tip"] - places["measured_0"]).norm(), tipOf(*measured).norm(),
                1e-12);
    return true;
  })) << "no measured_tip in tf";
}

TEST_F(Loop, TheOverlayIsDrawnForWhoeverLooks) {
  const Inbox<sensor_msgs::Image> overlay(eye_.node, names::kOverlay);
  ASSERT_TRUE(waitFor([&] { return !overlay.all().empty(); }));
  const sensor_msgs::Image& picture = overlay.last();
  EXPECT_EQ(picture.encoding, "bgr8");
  EXPECT_EQ(picture.width, image_.last().width);
  EXPECT_EQ(picture.height, image_.last().height);
  // Something of it has colour, and the rest is the gray picture.
  std::size_t coloured = 0;
  for (std::size_t k = 0; k + 2 < picture.data.size(); k += 3) {
    coloured += picture.data[k] != picture.data[k + 1] || picture.data[k] != picture.data[k + 2];
  }
  EXPECT_GT(coloured, picture.data.size() / 3 / 1000);
  EXPECT_LT(coloured, picture.data.size() / 3 / 4);
}

// Its tip moves to where the true arm has it under that force, and back.
TEST_F(Loop, AForceAtTheTipMovesTheTruth) {
  ros::Publisher publisher = eye_.node.advertise<geometry_msgs::WrenchStamped>(
      std::string(names::kSimulatedRigNode) + "/" + names::kTipForce, 10);
  ASSERT_TRUE(waitFor([&] { return publisher.getNumSubscribers() > 0; }));
  const io::Scene scene = shippedScene("demo");
  simulation::TrueArm truth(scene.model, scene.simulation.arm);
  const auto tipUnder = [&](const Eigen::Vector3d& force) {
    truth.setTipForce(force);
    return model::tipPose(truth.shape(Eigen::Vector3d::Zero())).translation;
  };
  const auto isAt = [&](const Eigen::Vector3d& tip) {
    return truth_.next([&](const ArmShape& shape) { return (tipOf(shape) - tip).norm() < 1e-5; });
  };
  const Eigen::Vector3d force(0, 0.3, -0.2), free = tipUnder({0, 0, 0}), pulled = tipUnder(force);
  ASSERT_GT((pulled - free).norm(), 1e-3);
  rig_.keepOn();
  ASSERT_EQ(rig_.sendPressures({0, 0, 0}).outcome, TargetStatus::REACHED);
  ASSERT_TRUE(isAt(free));
  geometry_msgs::WrenchStamped wrench;
  wrench.wrench.force.y = force.y();
  wrench.wrench.force.z = force.z();
  publisher.publish(wrench);
  ASSERT_TRUE(isAt(pulled));
  wrench.wrench.force.y = 0;
  wrench.wrench.torque.x = 0.01;
  publisher.publish(wrench);
  EXPECT_TRUE(waitFor([&] {
    return rig_process_->outputNow().find("~tip_force: the torque is (0.01, 0, 0) N m") !=
           std::string::npos;
  }));
  EXPECT_TRUE(isAt(pulled)) << "it stays";
  publisher.publish(geometry_msgs::WrenchStamped());
  EXPECT_TRUE(isAt(free));
}

TEST_F(Loop, ARigThatEndsIsReportedAndMeasuredAgainAfterItsRestart) {
  rig_process_->signal(SIGINT);
  EXPECT_EQ(rig_process_->exitCode(), 0) << rig_process_->output();
  EXPECT_TRUE(eye_.tells([](const VisionStatus& s) { return s.state == VisionStatus::STALE; }));
  EXPECT_TRUE(waitFor([this] {
    return !eye_.markers.all().empty() &&
           eye_.markers.last().markers.at(0).action == Marker::DELETE;
  }));
  using diagnostic_msgs::DiagnosticStatus;
  const auto comesTo = [this](const char* name, std::uint8_t level) {
    return nullptr != rig_.diagnostics.next([&](const diagnostic_msgs::DiagnosticArray& array) {
      return std::any_of(array.status.begin(), array.status.end(), [&](const auto& status) {
        return status.name == name && status.level == level;
      });
    });
  };
  EXPECT_TRUE(comesTo("vision: camera", DiagnosticStatus::ERROR));
  EXPECT_TRUE(comesTo(kLoop, DiagnosticStatus::ERROR));
  const std::size_t models = rig_.model.all().size();
  EXPECT_TRUE(comesTo(kLoop, DiagnosticStatus::ERROR));
  EXPECT_EQ(rig_.model.all().size(), models) << "a model without measurements";
  start();
  EXPECT_TRUE(eye_.measured.next([](const ArmShape&) { return true; }));
  EXPECT_TRUE(comesTo("vision: camera", DiagnosticStatus::OK));
  EXPECT_TRUE(rig_.model.next([](const ArmShape&) { return true; }));
}

// The arm of a rig beside another regulator, here the test's.
class RenderedArm : public ::testing::Test {
 protected:
  void SetUp() override {
    rig_ = std::make_unique<Process>(std::vector<std::string>{
        HELIX_ARM_SIMULATED_RIG, "_scene:=demo", "_camera_rate:=8", "_regulator:=topic"});
    ASSERT_TRUE(waitFor([this] { return readings_.getNumSubscribers() >= 2; })) << rig_->output();
  }

  // @return its stamp.
  ros::Time send(const std::vector<std::string>& name, const std::vector<double>& pressure) {
    PressureArray reading;
    reading.header.stamp = ros::Time::now();
    reading.name = name;
    reading.pressure = pressure;
    readings_.publish(reading);
    return reading.header.stamp;
  }
  // Repeats a reading until the condition holds.
  bool whileSending(const std::vector<std::string>& name, const std::vector<double>& pressure,
                    const std::function<bool()>& condition) {
    return waitFor([&] {
      send(name, pressure);
      return waitFor(condition, 0.02);
    });
  }

  bool says(const char* words) {
    return waitFor([&] { return rig_->outputNow().find(words) != std::string::npos; });
  }

  VisionListener eye_{""};
  ros::Publisher readings_ = eye_.node.advertise<PressureArray>(names::kPressureMeasured, 10);
  Inbox<ArmShape> truth_{eye_.node, names::kTruth};
  Inbox<sensor_msgs::Image> image_{eye_.node, names::kImage};
  std::unique_ptr<Process> rig_;
};

TEST_F(RenderedArm, IsSeenAtTheReadingsOfTheOtherRegulator) {
  const io::Scene scene = shippedScene("demo");
  const simulation::TrueArm arm(scene.model, scene.simulation.arm);
  const std::vector<std::string> names = {"muscle_3", "muscle_1", "muscle_2"};
  const Eigen::Vector3d tip = model::tipPose(arm.shape(Eigen::Vector3d(2.5e5, 1e5, 0))).translation;
  ASSERT_TRUE(whileSending(names, {0, 2.5e5, 1e5}, [this] {
    return !truth_.all().empty() && !image_.all().empty() && eye_.measured.all().size() > 3;
  })) << rig_->outputNow();
  EXPECT_LT((tipOf(truth_.last()) - tip).norm(), 1e-9);
  const auto measured = eye_.measured.all().back();
  EXPECT_LT((tipOf(*measured) - tip).norm(), 0.005);
  EXPECT_TRUE(VisionListener::of(truth_, measured->header.stamp));
  EXPECT_TRUE(VisionListener::of(image_, measured->header.stamp));

  // A broken reading moves nothing.
  const ros::Time broken = send(names, {0, std::nan(""), 1e5});
  EXPECT_TRUE(says("pressure_measured: ")) << rig_->outputNow();
  // Silence is told, and no picture of an arm whose pressure is unknown is taken.
  EXPECT_TRUE(says("no pressure_measured for 0.5 s")) << rig_->outputNow();
  const std::size_t pictures = image_.all().size();
  EXPECT_TRUE(eye_.tells([](const VisionStatus& s) { return s.state == VisionStatus::STALE; }));
  EXPECT_EQ(image_.all().size(), pictures);
  EXPECT_LT(truth_.last().header.stamp, broken);
  EXPECT_TRUE(whileSending(names, {0, 2.5e5, 1e5}, [&] { return image_.all().size() > pictures; }));
}

TEST_F(RenderedArm, ThatNoReadingEverComesIsTold) {
  EXPECT_TRUE(says("no pressure_measured has come for 3 s")) << rig_->outputNow();
  EXPECT_TRUE(image_.all().empty());
  EXPECT_TRUE(truth_.all().empty());
  // Then one comes, and its end is told as usual.
  ASSERT_TRUE(whileSending({"muscle_1", "muscle_2", "muscle_3"}, {0, 0, 0},
                           [this] { return !image_.all().empty(); }));
  EXPECT_TRUE(says("no pressure_measured for 0.5 s")) << rig_->outputNow();
}

}  // namespace
}  // namespace helix_arm::test
