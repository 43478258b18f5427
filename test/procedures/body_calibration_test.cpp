// A calibration from poses of motion-capture bodies: their frame is found from nothing.
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/io/scene.hpp"
#include "procedures/calibration_job.hpp"
#include "procedures/commissioning.hpp"
#include "procedures/pressure_plan.hpp"
#include "simulation/rig.hpp"
#include "support/shipped_scene.hpp"

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

}  // namespace
}  // namespace helix_arm::procedures
