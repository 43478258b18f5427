#include "helix_arm/localization/rig_memory.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>

namespace helix_arm::estimation {
namespace {

using Matrix = RigEstimate::Matrix;

// A shape is a new one if an entry of its twists differs by this much.
constexpr double kMoved = 0.005;  // [m]
constexpr double kTurned = 0.05;  // [rad]
constexpr int kMostFailures = 30;
// Part of what is known that remains after each later picture: a camera that was pushed is followed
// within some hundred different shapes, while one load, carried for some of them, changes little.
constexpr double kKept = 0.995;

Matrix inverseOf(const Matrix& covariance) {
  return Eigen::LLT<Matrix>(covariance).solve(Matrix::Identity());
}

}  // namespace

RigMemory::RigMemory(const TwistFitOptions& options, const Matrix& by_placements)
    : options_(options),
      by_placements_(by_placements),
      estimate_(options),
      teaches_(options.free_base || options.free_bleed),
      held_(!teaches_) {}

TwistFitOptions RigMemory::heldOptions(TwistFitOptions options) {
  options.base_prior.translation *= kSurest;
  options.base_prior.rotation *= kSurest;
  options.bleed_prior *= kSurest;
  return options;
}

Matrix RigMemory::heldErrors(const TwistFitOptions& options, const Matrix& by_placements) {
  const Matrix prior = RigEstimate(options).covariance;
  const Matrix whole = prior + by_placements;
  return RigEstimate(heldOptions(options)).covariance + prior -
         prior * Eigen::LLT<Matrix>(whole).solve(prior);
}

bool RigMemory::isNew(const model::Twists& twists) const {
  if (!taught_ || taught_->cols() != twists.cols()) return true;
  const model::Twists moved = (twists - *taught_).cwiseAbs();
  return moved.topRows<3>().maxCoeff() > kMoved || moved.bottomRows<3>().maxCoeff() > kTurned;
}

void RigMemory::learn(const TwistFit& fit) {
  if (fit.status != FitStatus::kConverged) {
    failures_ += fit.status == FitStatus::kUnexplained ? 1 : 0;
    if (failures_ >= kMostFailures) reset();
    return;
  }
  failures_ = 0;
  if (!teaches_ || !isNew(fit.twists)) return;
  taught_ = fit.twists;
  if (held_) {
    information_ *= kKept;
    weighted_ *= kKept;
  }
  // What the picture says beyond what the fit knew.
  const Matrix known = inverseOf(estimate_.covariance), after = inverseOf(fit.rig.covariance);
  information_ += after - known;
  weighted_ += after * fit.rig.mean - known * estimate_.mean;
  conclude();
}

void RigMemory::conclude() {
  const RigEstimate prior(options_), narrow(heldOptions(options_));
  const Matrix certain = inverseOf(prior.covariance);
  // Of z as a measurement of base and bleed: (information^-1 + Q)^-1.
  const Matrix damping = Matrix::Identity() + information_ * by_placements_;
  const Eigen::PartialPivLU<Matrix> damped(damping);
  const Matrix measured = damped.solve(information_);
  estimate_.mean = (certain + measured).partialPivLu().solve(damped.solve(weighted_));
  estimate_.covariance = inverseOf(certain + information_);
  const auto surer = [&](int first, int count) {
    return (estimate_.covariance.diagonal().segment(first, count).array() <=
            narrow.covariance.diagonal().segment(first, count).array())
        .all();
  };
  held_ |= (!options_.free_base || surer(0, 6)) && (!options_.free_bleed || surer(6, 1));
  if (held_) estimate_.covariance = narrow.covariance;
}

void RigMemory::reset() { *this = RigMemory(options_, by_placements_); }

}  // namespace helix_arm::estimation
