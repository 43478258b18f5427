#include "helix_arm/simulation/rig.hpp"

#include <random>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::simulation {
namespace {

const char* const kTrueMounts = "true mounts";

// Separate streams of one seed, so that the camera's noise does not affect the tags'.
enum Stream : std::uint32_t { kCameraStream, kTagStream };

class Noise {
 public:
  Noise(std::uint32_t seed, Stream stream) {
    std::seed_seq sequence{seed, static_cast<std::uint32_t>(stream)};
    generator_.seed(sequence);
  }
  lie::Vector6 draw(double translation, double rotation) {
    lie::Vector6 out;
    for (int i = 0; i < 6; ++i) out[i] = (i < 3 ? translation : rotation) * normal_(generator_);
    return out;
  }

 private:
  std::mt19937_64 generator_;
  std::normal_distribution<double> normal_;
};

constexpr statics::TierSetting kExact{statics::Tier::kExact, 0};

std::optional<statics::Load> deviate(std::optional<statics::Load> load,
                                     const ArmDeviation& deviation) {
  deviation.validate();
  if (!load) return load;
  for (double& K_eps : load->K_eps) K_eps *= deviation.K_eps_scale;
  return load;
}

statics::ArmModel deviate(const model::Arm& arm, const std::optional<statics::Load>& load,
                          const ArmDeviation& deviation) {
  model::Arm deviating =
      arm.scaledStiffness({deviation.K_gamma_scale, 1.0, deviation.K_kappa_scale});
  if (!load || load->empty()) return statics::ArmModel(std::move(deviating));
  return {std::move(deviating), std::nullopt, load, kExact};
}

// One factor per actuator.
Eigen::VectorXd lengthScalesOf(const ArmDeviation& deviation, int actuators) {
  const Eigen::VectorXd& each = deviation.length_scales;
  if (each.size() == 0) return Eigen::VectorXd::Constant(actuators, deviation.length_scale);
  basics::requireValue(each.size() == actuators, "true arm", "the number of length scales",
                       each.size(), "one per actuator");
  return deviation.length_scale * each;
}

std::string text(const Eigen::Vector3d& vector) {
  std::ostringstream out;
  out << "(" << vector.x() << ", " << vector.y() << ", " << vector.z() << ")";
  return out.str();
}

std::string describe(const statics::Load& load, const Eigen::Vector3d& tip_force) {
  const std::string force = "the force " + text(tip_force) + " N at the tip";
  if (load.empty()) return force;
  double mass = 0.0;
  for (const double m : load.mass) mass += m;
  std::ostringstream out;
  out << "the load of " << mass << " kg along the arm at gravity " << text(load.gravity)
      << " m/s^2 and " << load.points.size() << (load.points.size() == 1 ? " point" : " points");
  if (!tip_force.isZero(0)) out << ", and " << force;
  return out.str();
}

}  // namespace

void MountDeviation::validate() const {
  const auto check = [](const char* what, double value) {
    basics::requireNotNegative(kTrueMounts, what, value);
  };
  check("the deviation of the camera's place [m]", camera_translation);
  check("the deviation of the camera's direction [rad]", camera_rotation);
  check("the deviation of the tags' places [m]", tag_translation);
  check("the deviation of the tags' directions [rad]", tag_rotation);
}

estimation::TagLayout deviate(const estimation::TagLayout& layout, const model::Arm& arm,
                              const MountDeviation& deviation) {
  deviation.validate();
  layout.validate(arm.sectionCount());
  Noise noise(deviation.seed, kTagStream);
  const int base_tag = layout.baseTag();
  estimation::TagLayout out = layout;
  for (int i = 0; i < static_cast<int>(out.tags.size()); ++i) {
    const lie::Vector6 moved = noise.draw(deviation.tag_translation, deviation.tag_rotation);
    if (i == base_tag) continue;
    const double rest_length = arm.restLength(out.tags[i].section);
    out.tags[i] = estimation::movedBy(out.tags[i], moved, rest_length);
  }
  return out;
}

estimation::ArmView deviate(const estimation::ArmView& view, const model::Arm& arm,
                            const MountDeviation& deviation) {
  estimation::ArmView out = view;
  out.layout = deviate(view.layout, arm, deviation);
  Noise noise(deviation.seed, kCameraStream);
  out.X_CB = view.X_CB *
             lie::SE3::exp(noise.draw(deviation.camera_translation, deviation.camera_rotation));
  return out;
}

void ArmDeviation::validate() const {
  const auto check = [](const char* what, double value) {
    basics::requirePositive("true arm", what, value);
  };
  check("the factor on K_gamma", K_gamma_scale);
  check("the factor on K_kappa", K_kappa_scale);
  check("the factor on the lengths", length_scale);
  check("the factor on K_eps", K_eps_scale);
  for (const double scale : length_scales) check("the factor on a length", scale);
  if (response) response->validate();
}

TrueArm::TrueArm(const statics::ArmModel& model, const ArmDeviation& deviation)
    : load_(deviate(model.load(), deviation)),
      model_(deviate(model.arm(), load_, deviation)),
      length_scale_(lengthScalesOf(deviation, model.arm().actuatorCount())) {}

void TrueArm::setTipForce(const Eigen::Vector3d& force) {
  basics::require(force.allFinite(), "true arm: the force at the tip is ", text(force),
                  " N; expected finite numbers");
  if (force.isZero(0)) {
    pulled_.reset();
  } else {
    basics::require(load_.has_value(),
                    "arm.stiffness.K_eps_n is missing; expected a finite value > 0 [N] in every "
                    "section, which a force at the tip of the true arm needs");
    statics::Load load = *load_;
    statics::PointLoad tip;
    tip.section = arm().sectionCount() - 1;
    tip.offset = arm().link(tip.section).translation;
    tip.force = force;
    load.points.push_back(tip);
    pulled_.emplace(arm(), std::nullopt, std::move(load), kExact);
  }
  tip_force_ = force;
}

model::Shape TrueArm::shape(const model::InputRef& pressure) const {
  const Eigen::VectorXd clamped = arm().clamped(pressure);
  const statics::Solution solution =
      model().solveLengths(length_scale_.cwiseProduct(arm().lengths(clamped)));
  if (!solution.converged()) {
    std::ostringstream message;
    message << "true arm: at " << (1e-3 * clamped).transpose() << " kPa no shape balances "
            << describe(*load_, tip_force_) << " (" << statics::nameOf(solution.status)
            << ", residual " << solution.residual << "); lower the load or raise K_eps";
    throw std::runtime_error(message.str());
  }
  return solution.shape;
}

SimulatedRig::SimulatedRig(const statics::ArmModel& model,
                           const regulator::SimulatedRegulatorConfig& regulator_config,
                           const ArmDeviation& deviation, const std::optional<CameraSetup>& camera)
    : arm_(model, deviation),
      regulator_(model.arm().actuatorCount(), regulator_config),
      response_(model.arm(), deviation.response) {
  response_.step(regulator_.pressure(), 0);  // vented
  if (!camera) return;
  basics::requireValue(camera->view.sections == model.arm().sectionCount(), "simulated rig",
                       "the number of sections in the camera's view", camera->view.sections,
                       "as many as the arm has");
  camera_.emplace(camera->view, camera->family, camera->body, camera->config);
}

void SimulatedRig::setTipForce(const Eigen::Vector3d& force) {
  if (!plant_) return arm_.setTipForce(force);
  basics::require(force.allFinite(), "simulated rig: the force at the tip is ", text(force),
                  " N; expected finite numbers");
  plant_force_ = force;
}

void SimulatedRig::step(double dt) {
  regulator_.step(dt);
  if (plant_) {
    plant_->step(dt, regulator_.pressure(), plant_force_);
  } else {
    response_.step(regulator_.pressure(), dt);
  }
}

const cv::Mat& SimulatedRig::render() {
  if (!camera_) throw std::logic_error("simulated rig: there is no camera to render with");
  return camera_->render(shape());
}

}  // namespace helix_arm::simulation
