#include "helix_arm/localization/gaussian.hpp"

#include <Eigen/Cholesky>
#include <cmath>

#include "basics/pi.hpp"

namespace helix_arm::estimation {
namespace {

Eigen::LDLT<Eigen::MatrixXd> spread(const Eigen::MatrixXd& P,
                                    const Gaussian::Measurement& measurement) {
  return Eigen::LDLT<Eigen::MatrixXd>(measurement.H * P * measurement.H.transpose() +
                                      measurement.noise);
}

}  // namespace

double Gaussian::distance2(const Measurement& measurement) const {
  return measurement.innovation.dot(spread(covariance, measurement).solve(measurement.innovation));
}

double Gaussian::logLikelihood(const Measurement& measurement) const {
  const auto S = spread(covariance, measurement);
  const double log_determinant = S.vectorD().array().log().sum();
  const auto size = static_cast<double>(measurement.innovation.size());
  return -0.5 * (measurement.innovation.dot(S.solve(measurement.innovation)) + log_determinant +
                 size * std::log(2.0 * basics::kPi));
}

void Gaussian::update(const Measurement& measurement, Eigen::Index held) {
  const Eigen::MatrixXd& H = measurement.H;
  const auto S = spread(covariance, measurement);
  Eigen::MatrixXd gain = S.solve(H * covariance).transpose();
  gain.topRows(held).setZero();
  mean += gain * measurement.innovation;
  Eigen::MatrixXd kept = -gain * H;
  kept.diagonal().array() += 1.0;
  const Eigen::MatrixXd next =
      kept * covariance * kept.transpose() + gain * measurement.noise * gain.transpose();
  covariance = 0.5 * (next + next.transpose());
}

double tailOfF(double ratio, double above, double below) {
  const double a = 2 / (9 * above), b = 2 / (9 * below), root = std::cbrt(ratio);
  return std::erfc(((1 - b) * root - (1 - a)) / std::sqrt(2 * (b * root * root + a))) / 2;
}

}  // namespace helix_arm::estimation
