#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "response_tracker.hpp"

namespace helix_arm::follow {

/// Learns from turn to turn how a path is to be aimed: where it passes a place in the same
/// direction again, the tip is aimed off by what it missed there before. Hysteresis, lags and
/// uneven strokes repeat; pictures tell of them too late for the turn that they show (iterative
/// learning control).
///
/// Does not allocate.
class PathMemory {
 public:
  void clear() { rows_.clear(); }

  /// Where to aim, from the path's place [m]: the mean over the pictures of the last pass, less
  /// its uncertainty by their scatter; 0 where there was none, or the path stands.
  /// @param reach  within which places are alike [m].
  Eigen::Vector3d at(const Eigen::Vector3d& place, const Eigen::Vector3d& velocity,
                     double reach) const {
    const double speed = velocity.norm();
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    double weights = 0, squares = 0, square = 0;
    bool is_earlier = false;  // than the pass that goes on
    for (int age = 0; speed > kSlowest && age < rows_.count(); ++age) {
      const Row& row = rows_.at(age).value;
      const double away2 = (row.place - place).squaredNorm() / (reach * reach);
      const bool is_away = away2 > kLeft * kLeft;
      is_earlier = is_earlier || is_away;
      if (is_away && weights > kLeastWeight) break;  // the pass before knew less
      const double along = row.direction.dot(velocity) / speed;
      if (!is_earlier || away2 > kFarthest * kFarthest || along <= 0) continue;
      const double weight = std::exp(-away2 / 2) * along * along;
      weights += weight;
      squares += weight * weight;
      sum += weight * row.aim;
      square += weight * row.aim.squaredNorm();
    }
    if (weights < kLeastWeight) return Eigen::Vector3d::Zero();
    const Eigen::Vector3d mean = sum / weights;
    const double size2 = mean.squaredNorm();
    const double variance = (square / weights - size2) * squares / (weights * weights);
    if (size2 <= variance) return Eigen::Vector3d::Zero();
    return mean * (1 - variance / size2) * std::min(1.0, kMost / std::sqrt(size2));
  }

  /// Notes a picture. @param missed  of the measured tip from the path's place [m].
  void add(double time, const Eigen::Vector3d& place, const Eigen::Vector3d& velocity, double reach,
           const Eigen::Vector3d& missed) {
    if (velocity.norm() <= kSlowest) return;
    const Eigen::Vector3d aim = at(place, velocity, reach) - kGain * missed;
    rows_.add(time, {place, velocity.normalized(), aim});
  }

 private:
  static constexpr int kMostPictures = 1024;   // 34 s of 30 Hz
  static constexpr double kFarthest = 3.0;     // that counts, in the reach
  static constexpr double kLeft = 4.0;         // where a pass has ended, in the reach
  static constexpr double kSlowest = 1e-3;     // of a pass [m/s]
  static constexpr double kLeastWeight = 1.0;  // of the pictures of a place
  static constexpr double kGain = 0.5;         // part of an error that one pass makes up for
  static constexpr double kMost = 0.01;        // aimed off [m]

  struct Row {
    Eigen::Vector3d place, direction, aim;
  };
  TimeRing<Row, kMostPictures> rows_;
};

}  // namespace helix_arm::follow
