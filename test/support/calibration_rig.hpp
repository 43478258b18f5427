#pragma once

#include <actionlib/client/simple_action_client.h>
#include <ros/service.h>

#include "helix_arm/Calibrate.h"
#include "helix_arm/ClearSamples.h"
#include "helix_arm/FitContraction.h"
#include "helix_arm/RecordSample.h"
#include "helix_arm/Reload.h"
#include "helix_arm/RunCalibrationAction.h"
#include "helix_arm/SafetyState.h"
#include "helix_arm/Save.h"
#include "support/process.hpp"
#include "support/temporary_file.hpp"
#include "support/temporary_folder.hpp"
#include "support/vision_rig.hpp"

namespace helix_arm::test {

/// Calls a service of the calibration node, or of another one.
template <class Service>
typename Service::Response call(const std::string& name,
                                const typename Service::Request& request = {}) {
  Service service;
  service.request = request;
  const std::string path = name.find('/') == std::string::npos ? "calibration/" + name : name;
  EXPECT_TRUE(waitFor([&] { return ros::service::exists(path, false); })) << path;
  EXPECT_TRUE(ros::service::call(path, service)) << path;
  return service.response;
}

/// The simulated rig, whose time runs fast, and the calibration node; pressure_command and vision
/// are of the launch file.
class CalibrationRig : public ::testing::Test {
 protected:
  using Client = actionlib::SimpleActionClient<RunCalibrationAction>;

  static constexpr double kRamp = 2e5;         ///< of the run, in simulated time [Pa/s]
  static constexpr double kLongestStep = 0.1;  ///< of procedures::CalibrationRun [s]

  /// @param rig_scene  path of what the hardware is.
  explicit CalibrationRig(const std::string& rig_scene) : rig_scene_(rig_scene) {}

  void SetUp() override {
    rig_.keepOn();
    startRig();
    startCalibration();
    ASSERT_TRUE(waitFor([] { return !ros::Time::now().isZero(); })) << rig_process_->output();
    ASSERT_TRUE(waitFor([this] { return !safety_.all().empty(); }));
    ASSERT_TRUE(rig_.connect()) << rig_process_->output();
    ASSERT_TRUE(waitFor([this] { return wasEnabled(); }));
    ASSERT_TRUE(waitFor([this] { return !eye_.detections.all().empty(); }));
    freeTheArm();
    client_ = std::make_unique<Client>("calibration/run_calibration", false);  // asks for the time
    ASSERT_TRUE(waitFor([this] { return client_->isServerConnected(); }));
  }

  /// Sends no target until the arm has vented, unless it rests: the next target, from any sender,
  /// enables it again.
  void freeTheArm() {
    rig_.fallSilent();
    EXPECT_TRUE(waitFor(
        [this] { return safety_.last().state == "vented" || safety_.last().state == "disabled"; }));
  }

  bool wasEnabled() const {
    return std::any_of(safety_.all().begin(), safety_.all().end(),
                       [](const auto& safety) { return safety->state == "enabled"; });
  }

  /// Waits until the arm rests, and not after a fault.
  ::testing::AssertionResult restsWithoutAFault() {
    if (waitFor([this] { return safety_.last().state == "disabled"; })) {
      return ::testing::AssertionSuccess();
    }
    return ::testing::AssertionFailure() << safety_.last().reason;
  }

  void startRig() {
    rig_process_ = std::make_unique<Process>(
        std::vector<std::string>{HELIX_ARM_SIMULATED_RIG, "_scene:=" + rig_scene_,
                                 "_time_factor:=5", "_camera_rate:=8", "_rate:=200"});
  }

  void startCalibration() {
    const std::string folder = std::filesystem::temp_directory_path().string();
    calibration_ = std::make_unique<Process>(std::vector<std::string>{
        HELIX_ARM_CALIBRATION, "_scene:=demo", "_max_age_s:=5", "_pressure_tolerance_kpa:=6",
        "_ramp_kpa_s:=200", "_scene_folder:=" + folder, "_data_folder:=" + folder,
        "_out_folder:=" + folder});
  }

  /// Asks to record until it is done, or refused for another reason than motion.
  RecordSample::Response recordWhenSettled() {
    RecordSample::Response response;
    waitFor([&] {
      response = call<RecordSample>("record_sample");
      waitFor([] { return false; }, 0.05);
      return response.success;
    });
    return response;
  }

  /// How the action ended: SUCCEEDED, PREEMPTED or ABORTED.
  std::string ending() const { return client_->getState().toString(); }

  /// Waits until the action has ended; its result is then there.
  bool ends(double deadline = 45.0) {
    return waitFor([this] { return client_->getState().isDone(); }, deadline);
  }

  bool atRest() {
    return nullptr != rig_.command.next([](const PressureArray& command) {
      return command.pressure == std::vector<double>{0, 0, 0};
    });
  }

  /// Every step of the targets is one that the ramp allows, from this message on: however late one
  /// is, it makes up for no more than the longest step.
  void expectRamps(std::size_t first) const {
    const auto& targets = targets_.all();
    for (std::size_t k = first + 1; k < targets.size(); ++k) {
      const double change = (vectorOf(targets[k]->pressure) - vectorOf(targets[k - 1]->pressure))
                                .cwiseAbs()
                                .maxCoeff();
      EXPECT_LE(change, kRamp * kLongestStep * (1 + 1e-9));
    }
  }

  const std::string rig_scene_;
  Rig rig_;
  ros::NodeHandle node_;
  Inbox<PressureArray> targets_{node_, names::kPressureTarget};
  Inbox<SafetyState> safety_{node_, names::kSafetyState};
  VisionListener eye_{""};
  std::unique_ptr<Client> client_;
  std::unique_ptr<Process> rig_process_, calibration_;
};

}  // namespace helix_arm::test
