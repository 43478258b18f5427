#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

namespace helix_arm::statics {

/// Gauss-Legendre points on [0, 1], with integrals of the polynomials through values at them.
class GaussRule {
 public:
  static constexpr int kMostNodes = 16;
  using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMostNodes, 1>;
  using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMostNodes,
                               kMostNodes>;

  /// The rule with 1 to kMostNodes points.
  static const GaussRule& of(int nodes);

  int count() const { return static_cast<int>(nodes_.size()); }
  const Vector& nodes() const { return nodes_; }
  const Vector& weights() const { return weights_; }
  /// (nodes x nodes): column j holds the weights of the integral from 0 to node j.
  const Matrix& before() const { return before_; }
  /// Likewise for the integral from node j to 1.
  const Matrix& after() const { return after_; }

  /// Weights of the interpolated value at t in [0, 1].
  Vector at(double t) const;
  /// Weights of the coefficient of the highest mode, P_nodes-1.
  const Vector& highest() const { return highest_; }

  /// Weights of the integral from 0 to t in [0, 1].
  Vector upTo(double t) const;

 private:
  using Values = std::array<double, kMostNodes + 1>;

  explicit GaussRule(int count);
  static std::vector<GaussRule> all();
  Values legendre(double t) const;

  Vector nodes_, weights_, highest_;
  Matrix at_nodes_;  // P_n at the nodes, column n
  Matrix before_, after_;
};

}  // namespace helix_arm::statics
