#pragma once

#include <optional>

#include "time_ring.hpp"

namespace helix_arm::follow {

/// Detects an arm that moves away from a constant target, and goes on while the loop corrects it:
/// the model bends in the wrong direction.
class DivergenceWatch {
 public:
  /// @param patience  time in which the loop corrects an error that a load causes at once [s].
  explicit DivergenceWatch(double patience) : patience_(patience) {}

  void clear() {
    errors_.clear();
    suspicion_.reset();
  }

  /// @param error  of the measured tip [m]. @param corrected  whether the loop corrects it, at a
  ///     constant target within the model's reach.
  /// @return whether the arm diverges.
  bool add(double now, double error, bool corrected) {
    errors_.add(now, error);
    const auto earlier = errors_.before(now - kDoublingTime);
    const bool grows = earlier && error > kDiverged && error > 2 * *earlier;
    if (!corrected) {
      suspicion_.reset();
    } else if (!suspicion_) {
      if (grows) suspicion_ = Suspicion{now, error};
    } else if (error < kCorrectedPart * suspicion_->error) {
      suspicion_.reset();
    } else {
      return now - suspicion_->since >= patience_;
    }
    return false;
  }

 private:
  static constexpr double kDiverged = 0.02;     // [m]
  static constexpr double kDoublingTime = 1.0;  // within which the error doubles [s]
  // An error that a load causes at once shrinks to this part while the loop corrects it.
  static constexpr double kCorrectedPart = 0.75;
  static constexpr int kMostErrors = 512;  // of pictures

  // A divergence, unless the error shrinks.
  struct Suspicion {
    double since, error;  // [s], [m]
  };

  double patience_;
  TimeRing<double, kMostErrors> errors_;
  std::optional<Suspicion> suspicion_;
};

}  // namespace helix_arm::follow
