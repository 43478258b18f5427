#include "inertia_fit.hpp"

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

  // The slowest small vibration at inputs (n). Throws std::runtime_error where nothing vibrates.
  Vibration at(double mass, double damping, const Eigen::VectorXd& input) const {
    const auto found = dynamics::vibrationsOf(motion(mass, damping).linearisedAt(input));
    if (found.empty()) {
      throw std::runtime_error(
          "the arm of the scene does not vibrate with such masses and damping");
    }
    return found.front();
  }

  // Its tips (rows x 3) after the steps of a recording [m].
  Eigen::MatrixXd tipsOf(double mass, double damping, const model::InputHistory& history) const {
    const dynamics::ArmMotion moving = motion(mass, damping);
    Eigen::MatrixXd tips(history.rows(), 3);
    for (Eigen::Index begin = 0, end = 0; begin < history.rows(); begin = end) {
      dynamics::InputSeries series;
      for (end = begin; end == begin || (end < history.rows() && !history.starts_anew[end]);
           ++end) {
        series.time.push_back(history.time[end]);
      }
      series.input.resize(end - begin, history.input.cols());
      for (Eigen::Index row = begin; row < end; ++row) {
        series.input.row(row - begin) = arm_.clamped(history.input.row(row)).transpose();
      }
      moving.follow(
          series, dynamics::Start::kRest, series.time, [&](std::size_t row, const lie::SE3& tip) {
            tips.row(begin + static_cast<Eigen::Index>(row)) = tip.translation.transpose();
            return true;
          });
    }
    return tips;
  }

  Eigen::VectorXd inputOf(const RingDown& ring) const {
    return ring.input.size() == 0 ? arm_.inputAt(0.0) : arm_.clamped(ring.input);
  }

 private:
  dynamics::ArmMotion motion(double mass, double damping) const {
    statics::Load load = load_;
    for (double& one : load.mass) one *= mass;
    dynamics::MotionConfig config = config_;
    for (double* time : {&config.damping.stretch, &config.damping.shear, &config.damping.twist,
                         &config.damping.bend}) {
      *time *= damping;
    }
    return {arm_, planar_, load, config};
  }

  const model::Arm& arm_;
  const std::optional<model::PlanarArm>& planar_;
  const statics::Load& load_;
  const dynamics::MotionConfig& config_;
};

// The factor on the masses with which small vibrations have the release's frequency, by the secant
// method in logarithms, and the change of its logarithm by that of the frequency.
struct MassOf {
  double mass, by_frequency;

  MassOf(const Scaled& arm, const RingDown& ring) {
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
    mass = std::exp(x);
    by_frequency = 1 / slope;
  }
};

// The factor on the damping with which small vibrations have the release's damping ratio.
double dampingOf(const Scaled& arm, const RingDown& ring, double mass) {
  const Eigen::VectorXd input = arm.inputOf(ring);
  double factor = kLittleDamping;
  for (int i = 0; i < 4; ++i) factor *= ring.damping.value / arm.at(mass, factor, input).damping;
  return factor;
}

double relativeError(const Estimate& one) { return one.standard_error / one.value; }

// A fit by the releases that ring.
class Fit {
 public:
  Fit(const Scaled& arm, const ModeFit& rings, const InertiaParts& parts)
      : arm_(arm), parts_(parts) {
    for (const RingDown& ring : rings.rings) {
      if (ring.found()) measured_.push_back(&ring);
    }
  }

  // By small vibrations.
  void begin(InertiaFit& fit) {
    std::vector<Estimate> masses, dampings;
    for (const RingDown* ring : measured_) {
      const MassOf found(arm_, *ring);
      by_frequency_.push_back(found.by_frequency);
      masses.push_back(
          {found.mass, found.mass * std::abs(found.by_frequency) * relativeError(ring->frequency)});
    }
    if (parts_.mass) fit.mass = pooled(masses);
    for (const RingDown* ring : measured_) {
      const double factor = dampingOf(arm_, *ring, fit.mass.value);
      dampings.push_back({factor, factor * relativeError(ring->damping)});
    }
    if (parts_.damping) fit.damping = pooled(dampings);
  }

  // Vibrations of the arm with these factors, one after each release.
  void predict(const model::InputHistory& history, InertiaFit& fit) {
    const auto [mass, damping] = std::pair(fit.mass.value, fit.damping.value);
    const bool steps = history.input.cols() > 0;
    const Eigen::MatrixXd tips = steps ? arm_.tipsOf(mass, damping, history) : Eigen::MatrixXd();
    fit.predicted.clear();
    alike_.clear();
    for (const RingDown* ring : measured_) {
      alike_.push_back(steps ? refitted(*ring, history, tips) : *ring);
      const RingDown& alike = alike_.back();
      fit.predicted.push_back(steps && alike.found()
                                  ? Vibration{alike.frequency.value, alike.damping.value}
                                  : arm_.at(mass, damping, arm_.inputOf(*ring)));
    }
  }

  // Corrects the factors by what was predicted.
  void correct(InertiaFit& fit) const {
    std::vector<Estimate> masses, dampings;
    const bool any =
        std::any_of(alike_.begin(), alike_.end(), [](const RingDown& one) { return one.found(); });
    for (std::size_t i = 0; i < measured_.size(); ++i) {
      if (any && !alike_[i].found()) continue;  // in which the simulated arm does not ring
      const RingDown &ring = *measured_[i], &by = any ? alike_[i] : ring;
      const double mass =
          fit.mass.value *
          std::pow(ring.frequency.value / fit.predicted[i].frequency, by_frequency_[i]);
      const double damping = fit.damping.value * ring.damping.value / fit.predicted[i].damping;
      masses.push_back({mass, mass * std::abs(by_frequency_[i]) * relativeError(by.frequency)});
      dampings.push_back({damping, damping * relativeError(by.damping)});
    }
    if (parts_.mass) fit.mass = pooled(masses);
    if (parts_.damping) fit.damping = pooled(dampings);
  }

 private:
  const Scaled& arm_;
  const InertiaParts parts_;
  std::vector<const RingDown*> measured_;
  std::vector<double> by_frequency_;  // of the logarithm of the mass, about -2
  std::vector<RingDown> alike_;       // simulated, or those measured where no pressures are known
};

}  // namespace

InertiaFit fitInertia(const model::Arm& arm, const std::optional<model::PlanarArm>& planar,
                      const statics::Load& load, const dynamics::MotionConfig& config,
                      const model::InputHistory& history, const ModeFit& rings,
                      const InertiaParts& parts) {
  constexpr int kCorrections = 3;
  InertiaFit out;
  out.failure = rings.failure;
  if (!out.failure.empty()) return out;
  const Scaled scaled(arm, planar, load, config);
  Fit fit(scaled, rings, parts);
  try {
    fit.begin(out);
    for (int i = 0; i < kCorrections; ++i) {
      fit.predict(history, out);
      fit.correct(out);
    }
    fit.predict(history, out);
  } catch (const std::runtime_error& error) {
    out.failure = error.what();
  }
  return out;
}

}  // namespace helix_arm::estimation
