// A calibration from poses of motion-capture bodies: their frame is found from nothing, and what is
// recorded of them is read again.
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/io/tag_table.hpp"
#include "procedures/calibration_job.hpp"
#include "procedures/commissioning.hpp"
#include "procedures/pressure_plan.hpp"
#include "procedures/settle_watch.hpp"
#include "simulation/rig.hpp"
#include "support/has.hpp"
#include "support/shipped_scene.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::procedures {
namespace {

const std::string kPath = test::shippedPath("mocap");
const io::Override kUnknown{"motion_capture", "{}"};

double angleOf(const Eigen::Matrix3d& R) { return Eigen::AngleAxisd(R).angle(); }

// Poses of a rig that deviates from its scene, at 12 pressures, to a system whose frame is unknown.
CalibrationData recorded(const io::Scene& scene, const std::vector<io::Override>& rig) {
  const auto plan = std::get<Eigen::MatrixXd>(checkPlan(scene.arm, {}, false));
  return walkSimulatedRig(scene, test::shippedScene("mocap", rig), plan, 3);
}

class BodyCalibration : public ::testing::Test {
 protected:
  const io::Scene scene_ = test::shippedScene("mocap", {kUnknown});
  const std::vector<io::Override> rig_ = {
      test::kIdealRig,
      {"simulation.mounts", "{camera_translation_m: 0.3, camera_rotation_deg: 40, seed: 5}"}};
};

TEST_F(BodyCalibration, FindsTheFrameWhereverItIs) {
  const CalibrationData data = recorded(scene_, rig_);
  CalibrationRequest request;
  request.fit = {"base", "stiffness", "length_scale"};
  const CalibrationOutcome outcome = runCalibration(kPath, {kUnknown}, request, data);
  ASSERT_TRUE(outcome.success) << outcome.message;
  const io::Scene calibrated = io::sceneOfText(outcome.scene_text, "calibrated");
  ASSERT_TRUE(calibrated.motion_capture.X_BF);
  const lie::SE3 truth = test::shippedScene("mocap", rig_).cameraSetup()->view.X_CB.inverse();
  EXPECT_GT((scene_.X_BF.inverse() * truth).translation.norm(), 0.5);
  const lie::SE3 error = truth.inverse() * *calibrated.motion_capture.X_BF;
  // Error of the base, about which the arm is: 1.6 m away from the frame's origin.
  EXPECT_LT((truth * error * truth.inverse()).translation.norm(), 0.001);
  EXPECT_LT(angleOf(error.rotation), 0.002);
  for (const estimation::Parameter& one : parametersOf(outcome)) {
    if (one.name == "length_scale") {
      EXPECT_NEAR(one.value, 1.01, 0.003);
    }
  }
  // The tip is where the model says to the noise of its body.
  EXPECT_LT(outcome.tip_error_after.value(), 0.001);
}

TEST_F(BodyCalibration, FindsBodiesThatAreOtherwiseThanTheSceneSays) {
  // Its length is as the scene says: a body's place along the arm is not told from it.
  std::vector<io::Override> rig = rig_;
  rig.front().value = "{K_gamma_scale: 0.6, K_kappa_scale: 1.2}";
  rig.back().value = "{tag_translation_m: 0.0025, tag_rotation_deg: 2, seed: 5}";
  const CalibrationData data = recorded(scene_, rig);
  CalibrationRequest request;
  request.fit = {"stiffness", "placement"};
  const CalibrationOutcome outcome = runCalibration(kPath, {kUnknown}, request, data);
  ASSERT_TRUE(outcome.success) << outcome.message;
  const io::Scene calibrated = io::sceneOfText(outcome.scene_text, "calibrated");
  const auto setup = test::shippedScene("mocap", rig).cameraSetup();
  const auto& truth = setup->view.layout.tags;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const estimation::TagPlacement &found = calibrated.tags->tags[i],
                                   &before = scene_.tags->tags[i];
    EXPECT_EQ(found.name, before.name);
    const double length = scene_.arm.restLength();
    const auto off = [&](const estimation::TagPlacement& one) {
      return (one.X_ST.translation - truth[i].X_ST.translation +
              Eigen::Vector3d(length * (one.s - truth[i].s), 0, 0))
          .norm();
    };
    EXPECT_LE(off(found), std::max(0.0015, 0.5 * off(before))) << found.name;
  }
}

TEST(BodySamples, AreMediansAndReadAgain) {
  const lie::SE3 X{Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix(),
                   Eigen::Vector3d(1.2, -0.3, 2.5)};
  const TagObservation one = TagObservation::ofBody(2, X);
  TagObservation wild = one;
  *wild.points *= 1.5;
  const Eigen::VectorXd pressure = Eigen::Vector3d(1e5, 2e5, 3e5);
  const Sample median =
      medianOf({{1, pressure, {one}}, {2, pressure, {wild}}, {3, pressure, {one}}});
  ASSERT_EQ(median.tags.size(), 1U);
  EXPECT_LT((X.inverse() * median.tags[0].X_FM()).log().norm(), 1e-9);

  const std::vector<io::TagPoseCapture> captures = {{1, pressure, {{2, X, 0}}, 7.5}};
  const test::TemporaryFile file(io::tagPoseCsv(captures, 3, "recorded"), ".csv");
  const auto read = io::loadTagPoses(io::loadDataSet(file.path()), 3, lie::SE3());
  ASSERT_EQ(read.size(), 1U);
  EXPECT_EQ(read[0].time, 7.5);
  EXPECT_LT((X.inverse() * read[0].tags.at(0).X_BT).log().norm(), 1e-9);
}

// Bodies are at rest where their points move by less than the tolerance.
TEST(BodySamples, TellWhetherTheArmStandsStill) {
  SettleWatch watch({"muscle"}, SettleRules());
  const auto pass = [&watch](double from, double speed) {
    for (int k = 0; k < 300; ++k) {
      const double now = from + 0.01 * k;
      watch.command(now, Eigen::VectorXd::Constant(1, 1e5));
      watch.measured(now, Eigen::VectorXd::Constant(1, 1e5));
      const lie::SE3 X{Eigen::Matrix3d::Identity(), Eigen::Vector3d(speed * now, 0, 0)};
      watch.seen(now, {TagObservation::ofBody(0, X)});
    }
    return watch.at(from + 3);
  };
  EXPECT_TRUE(pass(0, 0.001).settled());
  const Settling moving = pass(10, 0.004);
  EXPECT_EQ(moving.state, SettleState::kMoving);
  EXPECT_TRUE(test::has(moving.reason, "the bodies moved by")) << moving.reason;
  EXPECT_TRUE(test::has(moving.reason, "expected at most 2 mm")) << moving.reason;
}

}  // namespace
}  // namespace helix_arm::procedures
