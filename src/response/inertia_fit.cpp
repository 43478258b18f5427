#include "helix_arm/response/inertia_fit.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/dynamics/arm_motion.hpp"

namespace helix_arm::estimation {
namespace {

using dynamics::Vibration;

constexpr double kLittleDamping = 1e-4;  // ratio at which it goes with its time constants
constexpr double kFarthest = 12.0;       // logarithm of a factor on the masses
constexpr double kFound = 1e-6;          // relative, of a frequency
constexpr int kMostTries = 40;

// The arm with other masses and damping.
class Scaled {
 public:
  Scaled(const model::Arm& arm, const std::optional<model::PlanarArm>& planar,
         const statics::Load& load, const dynamics::MotionConfig& config)
      : arm_(arm), planar_(planar), load_(load), config_(config) {}

  // The slowest vibration at inputs (n). Throws std::runtime_error where nothing vibrates.
  Vibration at(double mass, double damping, const Eigen::VectorXd& input) const {
    statics::Load load = load_;
    for (double& one : load.mass) one *= mass;
    dynamics::MotionConfig config = config_;
    for (double* time : {&config.damping.stretch, &config.damping.shear, &config.damping.twist,
                         &config.damping.bend}) {
      *time *= damping;
    }
    const dynamics::ArmMotion motion(arm_, planar_, load, config);
    const auto found = dynamics::vibrationsOf(motion.linearisedAt(input));
    if (found.empty()) {
      throw std::runtime_error(
          "the arm of the scene does not vibrate with such masses and damping");
    }
    return found.front();
  }

  Eigen::VectorXd inputOf(const RingDown& ring) const {
    return ring.input.size() == 0 ? arm_.inputAt(0.0) : arm_.clamped(ring.input);
  }

 private:
  const model::Arm& arm_;
  const std::optional<model::PlanarArm>& planar_;
  const statics::Load& load_;
  const dynamics::MotionConfig& config_;
};

// The factor on the masses with which the arm has the release's frequency: the secant method, in
// logarithms.
Estimate massOf(const Scaled& arm, const RingDown& ring) {
  const Eigen::VectorXd input = arm.inputOf(ring);
  const auto excess = [&](double log_mass) {
    const Vibration found = arm.at(std::exp(log_mass), kLittleDamping, input);
    return std::log(found.frequency / ring.frequency.value);
  };
  double x = 0.0, at = excess(x), slope = -0.5;
  for (int i = 0; std::abs(at) > kFound && i < kMostTries; ++i) {
    const double next = std::clamp(x - at / slope, -kFarthest, kFarthest);
    const double there = excess(next);
    if (next != x) slope = std::min((there - at) / (next - x), -0.05);
    x = next;
    at = there;
  }
  if (std::abs(at) > kFound) {
    throw std::runtime_error(basics::messageOf(
        "no masses of the sections make it vibrate at ", ring.frequency.value,
        " Hz; check arm.stiffness.K_eps_n, and the masses of load.tip and load.points"));
  }
  const double relative = ring.frequency.standard_error / ring.frequency.value;
  return {std::exp(x), std::exp(x) * relative / -slope};
}

// The factor on the damping with which it has the release's damping ratio.
Estimate dampingOf(const Scaled& arm, const RingDown& ring, double mass) {
  const Eigen::VectorXd input = arm.inputOf(ring);
  const double ratio = ring.damping.value;
  double factor = kLittleDamping;
  for (int i = 0; i < 4; ++i) factor *= ratio / arm.at(mass, factor, input).damping;
  return {factor, factor * ring.damping.standard_error / ratio};
}

}  // namespace

InertiaFit fitInertia(const model::Arm& arm, const std::optional<model::PlanarArm>& planar,
                      const statics::Load& load, const dynamics::MotionConfig& config,
                      const ModeFit& rings, const InertiaParts& parts) {
  InertiaFit fit;
  fit.failure = rings.failure;
  if (!fit.failure.empty()) return fit;
  const Scaled scaled(arm, planar, load, config);
  const auto each = [&rings](const auto& factorOf) {
    std::vector<Estimate> found;
    for (const RingDown& ring : rings.rings) {
      if (ring.found()) found.push_back(factorOf(ring));
    }
    return pooled(found);
  };
  try {
    if (parts.mass) fit.mass = each([&](const RingDown& ring) { return massOf(scaled, ring); });
    if (parts.damping) {
      fit.damping =
          each([&](const RingDown& ring) { return dampingOf(scaled, ring, fit.mass.value); });
    }
    for (const RingDown& ring : rings.rings) {
      if (!ring.found()) continue;
      fit.predicted.push_back(scaled.at(fit.mass.value, fit.damping.value, scaled.inputOf(ring)));
    }
  } catch (const std::runtime_error& error) {
    fit.failure = error.what();
  }
  return fit;
}

}  // namespace helix_arm::estimation
