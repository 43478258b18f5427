#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <functional>

#include <gtest/gtest.h>

#include "support/random.hpp"

namespace helix_arm::test {

/// A sample of a normal distribution.
inline Eigen::VectorXd drawNormal(const Eigen::MatrixXd& covariance, Random& random) {
  const Eigen::LDLT<Eigen::MatrixXd> factors(covariance);
  Eigen::VectorXd white(covariance.rows());
  for (double& value : white) value = random.normal();
  white.array() *= factors.vectorD().array().max(0.0).sqrt();
  return factors.transpositionsP().transpose() * Eigen::VectorXd(factors.matrixL() * white);
}

/// Covariance of tips about their mean.
inline Eigen::Matrix3d spreadOf(int samples, const std::function<Eigen::Vector3d()>& draw) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  for (int i = 0; i < samples; ++i) {
    const Eigen::Vector3d tip = draw();
    sum += tip;
    squares += tip * tip.transpose();
  }
  return squares / samples - sum * sum.transpose() / (samples * samples);
}

/// Whether a covariance that was sampled is the expected one in every direction, by variance.
inline void expectSpread(const Eigen::Matrix3d& sampled, const Eigen::Matrix3d& expected,
                         double tolerance) {
  const Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::Matrix3d> ratios(sampled, expected,
                                                                         Eigen::EigenvaluesOnly);
  EXPECT_GT(ratios.eigenvalues().minCoeff(), 1 - tolerance);
  EXPECT_LT(ratios.eigenvalues().maxCoeff(), 1 + tolerance);
}

}  // namespace helix_arm::test
