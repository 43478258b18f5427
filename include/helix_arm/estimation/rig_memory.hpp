#pragma once

#include <optional>

#include "helix_arm/estimation/twist_fit.hpp"

namespace helix_arm::estimation {

/// Remembers what pictures tell of base and bleed.
///
/// They stay as they are while the arm moves. A fit that frees them anew in every picture takes
/// half of what a force does to the arm for a motion of its base. Pictures of different shapes tell
/// them apart: each picture whose shape is a new one teaches, until they are known to kSurest of
/// their priors. From then on they are held.
class RigMemory {
 public:
  /// Part of the deviations of its priors to which an estimate is refined; placements and shapes
  /// that are not quite as thought allow no more.
  static constexpr double kSurest = 0.02;

  /// Starts with the priors of the options.
  explicit RigMemory(const TwistFitOptions& options);

  /// For the next fit.
  const RigEstimate& estimate() const { return estimate_; }
  /// Whether the estimate is held.
  bool isHeld() const { return held_; }

  /// After a fit that knew estimate(). One that has not converged teaches nothing; many of them in
  /// a row show that the camera was moved, and all begins anew.
  void learn(const TwistFit& fit);
  void reset();

  /// The options with priors as they are once estimates are held.
  static TwistFitOptions heldOptions(TwistFitOptions options);

 private:
  bool isNew(const model::Twists& twists) const;

  TwistFitOptions options_;
  RigEstimate estimate_;
  bool held_ = false;
  std::optional<model::Twists> taught_;  // of the last picture that taught
  int failures_ = 0;                     // in a row
};

}  // namespace helix_arm::estimation
