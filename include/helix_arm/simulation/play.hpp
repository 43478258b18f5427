#pragma once

#include <Eigen/Core>

namespace helix_arm::simulation {

/// Hysteresis of muscles as play: the pressure that an arm's shape feels follows the true one only
/// where that is farther away than the width, and stays where it was otherwise. The felt pressure
/// is then behind by the width, on the side from which the true one came.
class Play {
 public:
  /// Starts at 0. @param width  >= 0 [Pa]; 0: nothing is behind.
  /// @throws std::invalid_argument naming the value and its rule.
  Play(int channels, double width);

  /// Follows pressures (channels) [Pa]; all that lie between two calls are taken to lie between
  /// their values. @return felt().
  const Eigen::VectorXd& follow(const Eigen::VectorXd& pressure);
  /// (channels) [Pa].
  const Eigen::VectorXd& felt() const { return felt_; }

 private:
  double width_;
  Eigen::VectorXd felt_;
};

}  // namespace helix_arm::simulation
