#include "helix_arm/simulation/rig.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "helix_arm/model/requirement.hpp"

namespace helix_arm::simulation {
namespace {

model::Arm deviate(const model::Arm& arm, const ArmDeviation& deviation) {
  deviation.validate();
  std::vector<model::Section> sections(arm.sectionCount());
  for (int k = 0; k < arm.sectionCount(); ++k) {
    for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
      model::Actuator actuator = arm.actuator(i);
      actuator.stiffness.gamma *= deviation.K_gamma_scale;
      actuator.stiffness.kappa *= deviation.K_kappa_scale;
      sections[k].actuators.push_back(std::move(actuator));
    }
  }
  return model::Arm(std::move(sections));
}

}  // namespace

void ArmDeviation::validate() const {
  const auto check = [](const char* what, double value) {
    model::requireValue(std::isfinite(value) && value > 0, "true arm", what, value,
                        "a finite value > 0");
  };
  check("the factor on K_gamma", K_gamma_scale);
  check("the factor on K_kappa", K_kappa_scale);
  check("the factor on the lengths", length_scale);
}

TrueArm::TrueArm(const model::Arm& arm, const ArmDeviation& deviation)
    : arm_(deviate(arm, deviation)), length_scale_(deviation.length_scale) {}

model::Twists TrueArm::twists(const model::InputRef& pressure) const {
  return arm_.twistsOfLengths(length_scale_ * arm_.lengths(arm_.clamped(pressure)));
}

SimulatedRig::SimulatedRig(const model::Arm& arm,
                           const regulator::SimulatedRegulatorConfig& regulator_config,
                           const ArmDeviation& deviation, const std::optional<CameraSetup>& camera)
    : arm_(arm, deviation), regulator_(arm.actuatorCount(), regulator_config) {
  if (!camera) return;
  model::requireValue(camera->view.sections == arm.sectionCount(), "simulated rig",
                      "the number of sections in the camera's view", camera->view.sections,
                      "as many as the arm has");
  camera_.emplace(camera->view, camera->family, camera->body, camera->config);
}

const cv::Mat& SimulatedRig::render() {
  if (!camera_) throw std::logic_error("simulated rig: there is no camera to render with");
  return camera_->render(twists());
}

}  // namespace helix_arm::simulation
