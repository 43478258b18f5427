#pragma once

#include <Eigen/Core>

#include "helix_arm/estimation/arm_filter.hpp"
#include "helix_arm/estimation/gaussian.hpp"

namespace helix_arm::estimation {

/// A copy of a filter's state with a constant force on the arm from then on: [theta; b; f].
class LoadFork {
 public:
  /// @param watch  [theta; b]. @param deviation  standard deviation of each entry of f [N].
  LoadFork(const Gaussian& watch, double deviation);

  /// What happens between two pictures. @param creep  of the force [N s^-1/2].
  void predict(const ArmFilter::Step& step, double creep);
  /// The force may be another one by this much [N].
  void renewForce(double deviation);
  /// Adds to the covariance of b, (d x d).
  void growBias(const Eigen::MatrixXd& covariance);
  /// The fork's expectation of a picture, linear about the step's theta.
  /// @param by_force  (d x 3) change of the measured twists with f.
  Gaussian::Measurement expect(const ArmFilter::Step& step, const Eigen::MatrixXd& by_force) const;
  /// Covariance (d x d) of a picture's innovation.
  Eigen::MatrixXd spread(const Gaussian::Measurement& measurement) const {
    return measurement.H * state_.covariance * measurement.H.transpose() + measurement.noise;
  }
  void update(const Gaussian::Measurement& measurement) { state_.update(measurement); }
  double distance2(const Gaussian::Measurement& measurement) const {
    return state_.distance2(measurement);
  }
  double logLikelihood(const Gaussian::Measurement& measurement) const {
    return state_.logLikelihood(measurement);
  }

  Eigen::Vector3d force() const { return state_.mean.tail<3>(); }  // [N]
  Eigen::Matrix3d forceCovariance() const { return state_.covariance.bottomRightCorner<3, 3>(); }
  /// f' P_ff^-1 f, about twice the log likelihood ratio of a force against none.
  double score() const;
  /// [theta; b].
  Gaussian withoutForce() const;

 private:
  Gaussian state_;
};

}  // namespace helix_arm::estimation
