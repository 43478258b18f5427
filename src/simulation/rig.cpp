#include "helix_arm/simulation/rig.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::simulation {
namespace {

statics::ArmModel deviate(const statics::ArmModel& model, const ArmDeviation& deviation) {
  deviation.validate();
  model::Arm deviating =
      model.arm().scaledStiffness({deviation.K_gamma_scale, 1.0, deviation.K_kappa_scale});
  if (!model.load() || model.load()->empty()) return statics::ArmModel(std::move(deviating));
  statics::Load load = *model.load();
  for (double& K_eps : load.K_eps) K_eps *= deviation.K_eps_scale;
  return {std::move(deviating), std::nullopt, std::move(load),
          statics::TierSetting{statics::Tier::kExact, 0}};
}

// One factor per actuator.
Eigen::VectorXd lengthScalesOf(const ArmDeviation& deviation, int actuators) {
  const Eigen::VectorXd& each = deviation.length_scales;
  if (each.size() == 0) return Eigen::VectorXd::Constant(actuators, deviation.length_scale);
  basics::requireValue(each.size() == actuators, "true arm", "the number of length scales",
                       each.size(), "one per actuator");
  return deviation.length_scale * each;
}

std::string describe(const statics::Load& load) {
  double mass = 0.0;
  for (const double m : load.mass) mass += m;
  std::ostringstream out;
  out << "the load of " << mass << " kg along the arm at gravity (" << load.gravity.x() << ", "
      << load.gravity.y() << ", " << load.gravity.z() << ") m/s^2 and " << load.points.size()
      << (load.points.size() == 1 ? " point" : " points");
  return out.str();
}

}  // namespace

void ArmDeviation::validate() const {
  const auto check = [](const char* what, double value) {
    basics::requireValue(std::isfinite(value) && value > 0, "true arm", what, value,
                         "a finite value > 0");
  };
  check("the factor on K_gamma", K_gamma_scale);
  check("the factor on K_kappa", K_kappa_scale);
  check("the factor on the lengths", length_scale);
  check("the factor on K_eps", K_eps_scale);
  for (const double scale : length_scales) check("the factor on a length", scale);
}

TrueArm::TrueArm(const statics::ArmModel& model, const ArmDeviation& deviation)
    : model_(deviate(model, deviation)),
      length_scale_(lengthScalesOf(deviation, arm().actuatorCount())) {}

model::Shape TrueArm::shape(const model::InputRef& pressure) const {
  const Eigen::VectorXd clamped = arm().clamped(pressure);
  const statics::Solution solution =
      model_.solveLengths(length_scale_.cwiseProduct(arm().lengths(clamped)));
  if (!solution.converged()) {
    std::ostringstream message;
    message << "true arm: at " << (1e-3 * clamped).transpose() << " kPa no shape holds "
            << describe(*model_.load()) << " (" << statics::nameOf(solution.status) << ", residual "
            << solution.residual << "); lighten the load or raise K_eps";
    throw std::runtime_error(message.str());
  }
  return solution.shape;
}

SimulatedRig::SimulatedRig(const statics::ArmModel& model,
                           const regulator::SimulatedRegulatorConfig& regulator_config,
                           const ArmDeviation& deviation, const std::optional<CameraSetup>& camera)
    : arm_(model, deviation), regulator_(model.arm().actuatorCount(), regulator_config) {
  if (!camera) return;
  basics::requireValue(camera->view.sections == model.arm().sectionCount(), "simulated rig",
                       "the number of sections in the camera's view", camera->view.sections,
                       "as many as the arm has");
  camera_.emplace(camera->view, camera->family, camera->body, camera->config);
}

const cv::Mat& SimulatedRig::render() {
  if (!camera_) throw std::logic_error("simulated rig: there is no camera to render with");
  return camera_->render(shape());
}

}  // namespace helix_arm::simulation
