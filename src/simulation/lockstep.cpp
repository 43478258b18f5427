#include "helix_arm/simulation/lockstep.hpp"

#include <stdexcept>
#include <utility>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::simulation {
namespace {

constexpr char kCulprit[] = "lockstep";
constexpr double kRounding = 1e-9;  // of times [s]
constexpr int kMostReadings = 100;  // until the arm may be enabled

}  // namespace

void LockstepConfig::validate() const {
  const auto positive = [](const char* what, double value) {
    basics::requirePositive(kCulprit, what, value);
  };
  positive("the step [s]", step);
  positive("the pictures' period [s]", picture_period);
  basics::requireNotNegative(kCulprit, "the latency [s]", latency);
}

Lockstep::Lockstep(Parts parts, const LockstepConfig& config)
    : parts_(std::move(parts)), config_(config) {
  config_.validate();
  std::string refusal = "the regulator was not read";
  // With noise, single readings may look like pressure.
  for (int k = 0; k < kMostReadings && !refusal.empty(); ++k) {
    reading_ = parts_.rig.measure();
    parts_.core.measured(0.0, reading_);
    parts_.core.advance(0.0);
    refusal = parts_.core.enable(0.0);
  }
  if (!refusal.empty()) throw std::runtime_error("lockstep: " + refusal);
  parts_.loop.enable(true);
  parts_.loop.reading(0.0, parts_.core.orders().set_point, reading_);
}

lie::SE3 Lockstep::trueTip() const { return model::tipPose(parts_.rig.shape()); }

void Lockstep::advance() {
  ++steps_;
  const double now = time();
  const Eigen::VectorXd set_point = parts_.core.orders().set_point;
  parts_.rig.command(set_point);
  parts_.rig.step(config_.step);
  reading_ = parts_.rig.measure();
  parts_.core.measured(now, reading_);
  parts_.loop.enable(parts_.core.state() == control::SafetyState::kEnabled);
  const follow::Turn& turn = parts_.loop.reading(now, set_point, reading_);
  if (turn.commands) parts_.core.target(now, turn.pressure);
  parts_.core.advance(now);
  if (now + kRounding >= static_cast<double>(pictures_ + 1) * config_.picture_period) {
    ++pictures_;
    takePicture();
  }
  deliver();
}

void Lockstep::takePicture() {
  const double now = time();
  if (config_.blind && config_.blind->contains(now)) return;
  const Eigen::VectorXd pressure = parts_.model.arm().clamped(reading_);
  const model::Shape expected =
      statics::startingShape(parts_.model, parts_.model.solve(pressure), pressure);
  if (auto seen = parts_.vision.look(parts_.rig.shape(), expected)) {
    waiting_.push_back({now, now + config_.latency, std::move(*seen)});
  }
}

void Lockstep::deliver() {
  const double now = time();
  while (!waiting_.empty() && waiting_.front().due <= now + kRounding) {
    const Waiting& next = waiting_.front();
    const auto observation = parts_.loop.picture(next.stamp, now, next.shape.twists,
                                                 next.shape.covariance, next.shape.tags);
    if (observation.accepted()) ++accepted_;
    measured_ = MeasuredTip{next.stamp, next.shape.tip};
    waiting_.pop_front();
  }
}

}  // namespace helix_arm::simulation
