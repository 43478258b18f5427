#pragma once

#include <Eigen/Core>
#include <cmath>

#include "helix_arm/basics/pi.hpp"

namespace helix_arm::statics {

/// Gauss-Legendre points on [0, 1], with integrals of the polynomials through values at them.
template <int kNodes>
class GaussRule {
 public:
  using Vector = Eigen::Matrix<double, kNodes, 1>;
  using Matrix = Eigen::Matrix<double, kNodes, kNodes>;

  static const GaussRule& get() {
    static const GaussRule rule;
    return rule;
  }

  const Vector& nodes() const { return nodes_; }
  const Vector& weights() const { return weights_; }
  /// (nodes x nodes): column j holds the weights of the integral from 0 to node j.
  const Matrix& before() const { return before_; }
  /// Likewise for the integral from node j to 1.
  const Matrix& after() const { return after_; }

  /// Weights of the interpolated value at t in [0, 1].
  Vector at(double t) const {
    double P[kNodes + 1];
    legendre(t, P);
    Vector out = Vector::Zero();
    for (int n = 0; n < kNodes; ++n) out += (2 * n + 1) * P[n] * at_nodes_.col(n);
    return out.cwiseProduct(weights_);
  }
  /// Weights of the coefficient of the highest mode, P_nodes-1.
  const Vector& highest() const { return highest_; }

  /// Weights of the integral from 0 to t in [0, 1].
  Vector upTo(double t) const {
    // The polynomial that is 1 at node l is w_l sum_n (2n + 1) P_n(c_l) P_n(t), and (2n + 1) times
    // the integral of P_n is (P_n+1 - P_n-1) / 2.
    Vector out = Vector::Constant(t);
    double P[kNodes + 1];
    legendre(t, P);
    for (int n = 1; n < kNodes; ++n) out += 0.5 * (P[n + 1] - P[n - 1]) * at_nodes_.col(n);
    return out.cwiseProduct(weights_);
  }

 private:
  GaussRule() {
    for (int j = 0; j < kNodes; ++j) {
      double x = -std::cos(basics::kPi * (j + 0.75) / (kNodes + 0.5));
      double slope = 0.0;
      for (int i = 0; i < 8; ++i) {
        double P[kNodes + 1];
        legendre(0.5 * (1.0 + x), P);
        slope = kNodes * (x * P[kNodes] - P[kNodes - 1]) / (x * x - 1.0);
        x -= P[kNodes] / slope;
      }
      nodes_[j] = 0.5 * (1.0 + x);
      weights_[j] = 1.0 / ((1.0 - x * x) * slope * slope);
      double P[kNodes + 1];
      legendre(nodes_[j], P);
      for (int n = 0; n < kNodes; ++n) at_nodes_(j, n) = P[n];
    }
    highest_ = (2 * kNodes - 1) * at_nodes_.col(kNodes - 1).cwiseProduct(weights_);
    for (int j = 0; j < kNodes; ++j) before_.col(j) = upTo(nodes_[j]);
    after_ = (-before_).colwise() + weights_;
  }

  // P_0 .. P_kNodes, shifted to [0, 1].
  static void legendre(double t, double* P) {
    const double x = 2.0 * t - 1.0;
    P[0] = 1.0;
    P[1] = x;
    for (int n = 1; n < kNodes; ++n) P[n + 1] = ((2 * n + 1) * x * P[n] - n * P[n - 1]) / (n + 1);
  }

  Vector nodes_, weights_, highest_;
  Matrix at_nodes_;  // P_n at the nodes, column n
  Matrix before_, after_;
};

}  // namespace helix_arm::statics
