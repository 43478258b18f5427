#include "helix_arm/estimation/rig_memory.hpp"

#include <algorithm>

namespace helix_arm::estimation {
namespace {

// A shape is a new one if an entry of its twists differs by this much.
constexpr double kMoved = 0.005;  // [m]
constexpr double kTurned = 0.05;  // [rad]
constexpr int kMostFailures = 30;

}  // namespace

RigMemory::RigMemory(const TwistFitOptions& options)
    : options_(options), estimate_(options), held_(!options.free_base && !options.free_bleed) {}

TwistFitOptions RigMemory::heldOptions(TwistFitOptions options) {
  options.base_prior.translation *= kSurest;
  options.base_prior.rotation *= kSurest;
  options.bleed_prior *= kSurest;
  return options;
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
  if (held_ || !isNew(fit.twists)) return;
  taught_ = fit.twists;
  estimate_ = fit.rig;
  const RigEstimate held(heldOptions(options_));
  const auto surer = [&](int first, int count) {
    return (estimate_.covariance.diagonal().segment(first, count).array() <=
            held.covariance.diagonal().segment(first, count).array())
        .all();
  };
  held_ = (!options_.free_base || surer(0, 6)) && (!options_.free_bleed || surer(6, 1));
  if (held_) estimate_.covariance = held.covariance;
}

void RigMemory::reset() { *this = RigMemory(options_); }

}  // namespace helix_arm::estimation
