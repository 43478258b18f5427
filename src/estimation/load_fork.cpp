#include "load_fork.hpp"

#include <Eigen/Cholesky>
#include <cmath>

namespace helix_arm::estimation {

LoadFork::LoadFork(const Gaussian& watch, double deviation) {
  const Eigen::Index size = watch.mean.size();
  state_.mean = Eigen::VectorXd::Zero(size + 3);
  state_.mean.head(size) = watch.mean;
  state_.covariance = Eigen::MatrixXd::Zero(size + 3, size + 3);
  state_.covariance.topLeftCorner(size, size) = watch.covariance;
  state_.covariance.diagonal().tail<3>().setConstant(deviation * deviation);
}

void LoadFork::growBias(const Eigen::MatrixXd& covariance) {
  const Eigen::Index d = covariance.rows(), begin = state_.mean.size() - 3 - d;
  state_.covariance.block(begin, begin, d, d) += covariance;
}

void LoadFork::predict(const ArmFilter::Step& step, double creep) {
  growBias(step.bias_growth);
  renewForce(creep * std::sqrt(step.dt));
}

void LoadFork::renewForce(double deviation) {
  state_.covariance.diagonal().tail<3>().array() += deviation * deviation;
}

Gaussian::Measurement LoadFork::expect(const ArmFilter::Step& step,
                                       const Eigen::MatrixXd& by_force) const {
  const Eigen::Index parameters = step.theta.size(), d = step.measured.size();
  Eigen::MatrixXd H(d, parameters + d + 3);
  H << step.model.by_theta, Eigen::MatrixXd::Identity(d, d), by_force;
  Eigen::VectorXd from = state_.mean;
  from.head(parameters) -= step.theta;
  return {step.measured - step.model.twists - H * from, H, step.noise};
}

double LoadFork::score() const {
  return force().dot(Eigen::LDLT<Eigen::Matrix3d>(forceCovariance()).solve(force()));
}

Gaussian LoadFork::withoutForce() const {
  const Eigen::Index size = state_.mean.size() - 3;
  return {state_.mean.head(size), state_.covariance.topLeftCorner(size, size)};
}

}  // namespace helix_arm::estimation
