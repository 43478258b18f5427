// A whole calibration: a rig that is not what its scene says, pressures, pictures, samples, the
// fit, the file, and the nodes that go on with it. Time runs at five times its pace.
#include "ros_bridge/cockpit/cockpit_words.hpp"
#include "support/calibration_rig.hpp"

namespace helix_arm::test {
namespace {

constexpr char kDemo[] = HELIX_ARM_SOURCE_DIR "/config/scenes/demo.yaml";

// The demo, whose arm deviates from its scene, with a camera and tags that are displaced as well.
std::string displacedDemo() {
  return io::sceneText(kDemo, {{"simulation.mounts.camera_translation_m", "0.004"},
                               {"simulation.mounts.camera_rotation_deg", "0.5"},
                               {"simulation.mounts.tag_translation_m", "0.001"},
                               {"simulation.mounts.tag_rotation_deg", "1"},
                               {"simulation.mounts.seed", "11"}});
}

class WholeCalibration : public CalibrationRig {
 protected:
  WholeCalibration() : CalibrationRig(kRigScene.path()) {}

  static const TemporaryFile kRigScene;
};
const TemporaryFile WholeCalibration::kRigScene(displacedDemo());

TEST_F(WholeCalibration, RunsThroughItsPlanAndLeavesASceneThatPredictsBetter) {
  const TemporaryFolder folder;
  RunCalibrationGoal goal;
  goal.fit = {"stiffness", "length_scale", "placement"};
  goal.out = folder / "calibrated.yaml";
  std::vector<RunCalibrationFeedback> progress;
  const std::size_t first_target = targets_.all().size();
  client_->sendGoal(goal, {}, {},
                    [&](const RunCalibrationFeedbackConstPtr& f) { progress.push_back(*f); });
  ASSERT_TRUE(ends()) << calibration_->output();
  const RunCalibrationResult result = *client_->getResult();
  ASSERT_EQ(ending(), "SUCCEEDED") << result.message;
  EXPECT_TRUE(result.success);
  EXPECT_EQ(result.out, goal.out);
  EXPECT_EQ(result.message.rfind("tip error ", 0), 0u) << result.message;
  EXPECT_GT(result.tip_error_before, 0.005);
  EXPECT_LT(result.tip_error_after, 0.5 * result.tip_error_before);
  EXPECT_TRUE(atRest());
  EXPECT_TRUE(restsWithoutAFault()) << calibration_->outputNow();
  expectRamps(first_target);

  // Told step by step.
  ASSERT_FALSE(progress.empty());
  EXPECT_EQ(progress.front().step, 1u);
  EXPECT_EQ(progress.back().step, 12u);
  EXPECT_EQ(progress.back().steps, 12u);
  EXPECT_EQ(progress.back().samples, 12u);
  EXPECT_EQ(progress.back().state, "fitting");

  // How much better it predicts is measured in accuracy/.
  const io::Scene demo = shippedScene("demo"), calibrated = io::loadScene(goal.out);
  ASSERT_TRUE(calibrated.calibration);
  EXPECT_EQ(calibrated.calibration->data.at(0).captures, 12);
  ASSERT_EQ(result.names.size(), result.values.size());
  ASSERT_EQ(result.names.size(), result.standard_errors.size());
  const auto scale = std::find(result.names.begin(), result.names.end(), "length_scale");
  ASSERT_NE(scale, result.names.end());
  const auto k = static_cast<std::size_t>(scale - result.names.begin());
  EXPECT_TRUE(result.identifiable[k]);
  EXPECT_LT(std::abs(result.values[k] - demo.simulation.arm.length_scale),
            3 * result.standard_errors[k]);

  Save::Request save;
  save.path = folder / "saved.yaml";
  EXPECT_TRUE(call<Save>("save", save).success);
  EXPECT_EQ(io::loadScene(save.path).arm.tip(Eigen::Vector3d(3e5, 0, 1e5)).translation,
            calibrated.arm.tip(Eigen::Vector3d(3e5, 0, 1e5)).translation);

  // The samples remain: saved, and calibrated from the file, they tell the same.
  save.path = folder / "samples.csv";
  EXPECT_TRUE(call<Save>("save", save).success);
  Calibrate::Request again;
  again.fit = goal.fit;
  again.data = {save.path};
  const Calibrate::Response from_file = call<Calibrate>("calibrate", again);
  EXPECT_TRUE(from_file.success) << from_file.message;
  ASSERT_EQ(from_file.names, result.names);
  EXPECT_LT((vectorOf(from_file.values) - vectorOf(result.values)).norm(),
            1e-6 * vectorOf(result.values).norm());

  // The nodes go on with the new file, and their model is where the camera sees the arm.
  const auto tipErrorSeen = [&] {
    freeTheArm();
    const ros::Time moved = ros::Time::now();
    // The calibration holds the arm for safety.commander_timeout_s after its last target.
    TargetStatus answer;
    EXPECT_TRUE(waitFor([&] {
      answer = rig_.sendPressures({3.5e5, 0, 1e5});
      return answer.outcome == TargetStatus::REACHED;
    })) << answer.message;
    const auto error = eye_.errors.next(
        [&](const ModelError& e) { return (e.header.stamp - moved).toSec() > 3.0; });
    EXPECT_TRUE(error);
    return error ? error->tip_error : 1.0;
  };
  const double seen_before = tipErrorSeen();
  // As the cockpit's button does.
  const ros_bridge::CallAnswer used = ros_bridge::useLastCalibration("/");
  EXPECT_TRUE(used.success) << used.message;
  const std::size_t cut = used.message.find(" is used by pressure_command, vision, calibration");
  ASSERT_NE(cut, std::string::npos) << used.message;
  EXPECT_TRUE(std::filesystem::remove(used.message.substr(0, cut))) << used.message;
  EXPECT_LE(tipErrorSeen(), seen_before / 2) << "from " << 1e3 * seen_before << " mm";
}

TEST_F(WholeCalibration, FitsFreeLengthsAndPutsTheCurveIntoTheScene) {
  const TemporaryFolder folder;
  const io::Scene demo = shippedScene("demo");
  const model::Contraction& curve = demo.arm.actuator(0).contraction;
  std::ostringstream table;
  table.precision(17);
  table << "# the demo's muscle, 2 % longer\npressure_kpa,length_m\n";
  for (int k = 0; k <= 40; ++k) {
    const double pressure = curve.inputRange().upper * k / 40;
    table << 1e-3 * pressure << "," << 1.02 * curve.length(pressure) << "\n";
  }
  const TemporaryFile data(table.str(), ".csv");
  FitContraction::Request request;
  request.data = data.path();
  request.out = folder / "longer.yaml";
  const FitContraction::Response response = call<FitContraction>("fit_contraction", request);
  ASSERT_TRUE(response.success) << response.message;
  EXPECT_LT(response.rms, 1e-8);
  EXPECT_EQ(response.coefficients.size(), 6u);
  EXPECT_NEAR(io::loadScene(response.out).arm.actuator(2).contraction.length(1e5),
              1.02 * curve.length(1e5), 1e-7);
}

class LoopCalibration : public CalibrationRig {
 protected:
  LoopCalibration() : CalibrationRig(kLaggingRig.path()) {}

  static const TemporaryFile kLaggingRig;
};
const TemporaryFile LoopCalibration::kLaggingRig(
    io::sceneText(kDemo, {{"simulation.arm.response",
                           "{rise_time_constant_s: 0.3, fall_time_constant_s: 0.6, play_kpa: [8], "
                           "play_weight: [0.6]}"}}));

TEST_F(LoopCalibration, RunsThereAndBackAndFitsTheResponse) {
  const TemporaryFolder folder;
  RunCalibrationGoal goal;
  goal.fit = {"response", "stiffness", "length_scale"};
  goal.captures_per_pressure = 1;
  goal.loop = true;
  goal.out = folder / "calibrated.yaml";
  const std::size_t first_target = targets_.all().size();
  std::vector<RunCalibrationFeedback> progress;
  client_->sendGoal(goal, {}, {},
                    [&](const RunCalibrationFeedbackConstPtr& f) { progress.push_back(*f); });
  ASSERT_TRUE(ends()) << calibration_->output();
  const RunCalibrationResult result = *client_->getResult();
  ASSERT_EQ(ending(), "SUCCEEDED") << result.message;
  ASSERT_FALSE(progress.empty());
  EXPECT_EQ(progress.back().steps, 23u);
  EXPECT_EQ(progress.back().samples, 23u);
  EXPECT_TRUE(atRest());
  EXPECT_TRUE(restsWithoutAFault()) << calibration_->outputNow();
  expectRamps(first_target);
  const auto valueOf = [](const auto& answer, const std::string& name) {
    const auto place = std::find(answer.names.begin(), answer.names.end(), name);
    EXPECT_NE(place, answer.names.end()) << name;
    return place == answer.names.end()
               ? 0.0
               : answer.values[static_cast<std::size_t>(place - answer.names.begin())];
  };
  EXPECT_NEAR(valueOf(result, "rise_time_constant"), 0.3, 0.15);
  EXPECT_NEAR(valueOf(result, "fall_time_constant"), 0.6, 0.3);
  const io::Scene calibrated = io::loadScene(goal.out);
  EXPECT_GT(calibrated.contractions.at("fig3_muscle").rise_time, 0.1);

  // Samples and series, saved and read again, tell the same.
  Save::Request save;
  save.path = folder / "samples.csv";
  const Save::Response saved = call<Save>("save", save);
  ASSERT_TRUE(saved.success) << saved.message;
  EXPECT_NE(saved.message.find("samples_series.csv"), std::string::npos) << saved.message;
  Calibrate::Request again;
  again.fit = goal.fit;
  again.data = {save.path, folder / "samples_series.csv"};
  const Calibrate::Response response = call<Calibrate>("calibrate", again);
  ASSERT_TRUE(response.success) << response.message;
  ASSERT_EQ(response.names, result.names);
  EXPECT_LT((vectorOf(response.values) - vectorOf(result.values)).norm(),
            0.02 * vectorOf(result.values).norm());
}

}  // namespace
}  // namespace helix_arm::test
