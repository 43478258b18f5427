#include "rig.hpp"

#include <algorithm>
#include <cmath>
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

// One factor per actuator.
Eigen::VectorXd scalesOf(const Eigen::VectorXd& each, const char* what, int actuators) {
  if (each.size() == 0) return Eigen::VectorXd::Ones(actuators);
  basics::requireValue(each.size() == actuators, "true arm", what, each.size(), "one per actuator");
  return each;
}

statics::ArmModel deviate(const model::Arm& arm, const std::optional<statics::Load>& load,
                          const ArmDeviation& deviation) {
  model::Arm deviating =
      arm.scaledStiffness({deviation.K_gamma_scale, 1.0, deviation.K_kappa_scale});
  const Eigen::VectorXd scales =
      scalesOf(deviation.stiffness_scales, "the number of stiffness scales", arm.actuatorCount());
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    if (scales[i] == 1) continue;
    const model::Stiffness& known = deviating.actuator(i).stiffness;
    deviating = deviating.withStiffness(
        i, {scales[i] * known.gamma, scales[i] * known.tau, scales[i] * known.kappa});
  }
  if (!load || load->empty()) return statics::ArmModel(std::move(deviating));
  return {std::move(deviating), std::nullopt, load, kExact};
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
  return basics::messageOf("the load of ", mass, " kg along the arm at gravity ",
                           text(load.gravity), " m/s^2 and ", load.points.size(),
                           load.points.size() == 1 ? " point" : " points",
                           tip_force.isZero(0) ? "" : ", and " + force);
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
  for (const double scale : stroke_scales) check("the factor on a stroke", scale);
  for (const double scale : stiffness_scales) check("the factor on a stiffness", scale);
  if (response) response->validate();
  basics::requireNotNegative("true arm", "the dead time [s]", dead_time);
  if (!inertia) return;
  inertia->motion.validate();
  if (inertia->mass) check("its mass [kg]", *inertia->mass);
  if (inertia->K_eps) check("its K_eps [N]", *inertia->K_eps);
}

TrueArm::TrueArm(const statics::ArmModel& model, const ArmDeviation& deviation)
    : load_(deviate(model.load(), deviation)),
      model_(deviate(model.arm(), load_, deviation)),
      length_scale_(deviation.length_scale * scalesOf(deviation.length_scales,
                                                      "the number of length scales",
                                                      model.arm().actuatorCount())),
      stroke_scale_(scalesOf(deviation.stroke_scales, "the number of stroke scales",
                             model.arm().actuatorCount())) {}

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
  Eigen::VectorXd lengths = arm().lengths(clamped);
  for (int i = 0; i < arm().actuatorCount(); ++i) {
    const double rest = arm().actuator(i).contraction.restLength();
    lengths[i] = length_scale_[i] * (rest + stroke_scale_[i] * (lengths[i] - rest));
  }
  const statics::Solution solution = model().solveLengths(lengths);
  if (!solution.converged()) {
    throw std::runtime_error(
        basics::messageOf("true arm: at ", (1e-3 * clamped).transpose(), " kPa no shape balances ",
                          describe(*load_, tip_force_), " (", statics::nameOf(solution.status),
                          ", residual ", solution.residual, "); lower the load or raise K_eps"));
  }
  return solution.shape;
}

namespace {

statics::Load massesOf(const model::Arm& arm, const std::optional<statics::Load>& load,
                       const ArmInertia& inertia) {
  const auto sections = static_cast<std::size_t>(arm.sectionCount());
  statics::Load out = load.value_or(statics::Load{});
  out.gravity.setZero();
  for (statics::PointLoad& point : out.points) {
    point.force.setZero();
    point.moment.setZero();
  }
  if (inertia.K_eps) out.K_eps.assign(sections, *inertia.K_eps);
  if (!inertia.mass) return out;
  out.mass.resize(sections);
  for (int k = 0; k < arm.sectionCount(); ++k) {
    out.mass[static_cast<std::size_t>(k)] = *inertia.mass * arm.restLength(k) / arm.restLength();
  }
  return out;
}

}  // namespace

Swing::Swing(const model::Arm& arm, const std::optional<statics::Load>& load,
             const ArmInertia& inertia)
    : arm_(arm, massesOf(arm, load, inertia), inertia.motion), motion_(arm_) {}

void Swing::step(const model::Shape& rest, double dt) {
  if (shape_.sectionCount() == 0 || std::isinf(dt)) {
    rest_ = rest.twists();
    Eigen::VectorXd position(arm_.coordinates());
    arm_.setTwists(rest_, position);
    motion_.startAt(rest_, {position, Eigen::VectorXd::Zero(position.size())});
    shape_ = rest;
    return;
  }
  if (dt == 0) return;
  constexpr double kRounding = 1e-9;  // in steps
  const double steps = std::max(1.0, std::ceil(dt / arm_.config().step - kRounding));
  const model::Twists change = rest.twists() - rest_;
  for (double i = 1; i <= steps; ++i) {
    if (!motion_.step(dt / steps, rest_ + i / steps * change)) {
      throw std::runtime_error(
          basics::messageOf("true arm: its motion finds no solution in a step of ", dt / steps,
                            " s; shorten simulation.arm.dynamics.step_s, or raise its damping_s"));
    }
  }
  rest_ = rest.twists();
  shape_ = rest.about(Eigen::Map<const model::Twists>(motion_.position().data(), 6, rest_.cols()));
}

MovingArm::MovingArm(const statics::ArmModel& model, const ArmDeviation& deviation)
    : arm_(model, deviation),
      response_(model.arm(), deviation.response),
      dead_time_(deviation.dead_time) {
  if (!deviation.inertia) return;
  swing_ =
      std::make_unique<Swing>(arm_.arm(), deviate(model.load(), deviation), *deviation.inertia);
}

const Eigen::VectorXd& MovingArm::arrived(const model::InputRef& pressure, double dt) {
  if (std::isinf(dt)) on_the_way_.clear();
  if (std::isfinite(dt)) time_ += dt;
  on_the_way_.emplace_back(time_, pressure);
  while (on_the_way_.size() > 1 && on_the_way_[1].first <= time_ - dead_time_) {
    on_the_way_.pop_front();
  }
  return on_the_way_.front().second;
}

void MovingArm::step(const model::InputRef& pressure, double dt) {
  response_.step(arrived(pressure, dt), dt);
  if (swing_) swing_->step(arm_.shape(response_.effective()), dt);
}

void MovingArm::follow(double time, const model::InputRef& pressure) {
  if (last_reading_ && time < *last_reading_) {
    response_.restart();
    on_the_way_.clear();
    if (swing_) swing_->restart();
    last_reading_.reset();
  }
  const double dt = time - last_reading_.value_or(time);
  last_reading_ = time;
  step(pressure, dt);
}

model::Shape MovingArm::shape() const {
  return swing_ ? swing_->shape() : arm_.shape(response_.effective());
}

SimulatedRig::SimulatedRig(const statics::ArmModel& model,
                           const regulator::SimulatedRegulatorConfig& regulator_config,
                           const ArmDeviation& deviation, const std::optional<CameraSetup>& camera)
    : arm_(model, deviation), regulator_(model.arm().actuatorCount(), regulator_config) {
  step(0.0);  // vented
  if (!camera || camera->view.layout.hasBodies()) return;
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
  if (plant_) return plant_->step(dt, regulator_.pressure(), plant_force_);
  arm_.step(regulator_.pressure(), dt);
}

model::Shape SimulatedRig::shape() const { return plant_ ? plant_->shape() : arm_.shape(); }

const cv::Mat& SimulatedRig::render() {
  if (!camera_) throw std::logic_error("simulated rig: there is no camera to render with");
  return camera_->render(shape());
}

}  // namespace helix_arm::simulation
