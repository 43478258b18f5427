#pragma once

#include <Eigen/Core>
#include <vector>

namespace helix_arm::statics {

/// Minimises 1/2 x' H x + g' x over lower <= x <= upper by a primal active-set method from x = 0.
///
/// Set the members, then call solve(). All memory is allocated in the constructor.
class BoxQuadratic {
 public:
  explicit BoxQuadratic(int n);

  Eigen::MatrixXd H;      ///< (n x n) symmetric positive definite; only the lower triangle is read
  Eigen::VectorXd g;      ///< (n)
  Eigen::VectorXd lower;  ///< (n) <= 0
  Eigen::VectorXd upper;  ///< (n) >= 0

  /// The minimiser (n), valid until the next call.
  const Eigen::VectorXd& solve() noexcept;

 private:
  enum class State : char { kFree, kLower, kUpper };

  double coupling(int i, int j) const { return i >= j ? H(i, j) : H(j, i); }
  void solveFree() noexcept;
  bool advance() noexcept;
  bool release() noexcept;

  int n_;
  int free_count_ = 0;
  std::vector<int> free_;  // indices of the free variables
  std::vector<State> state_;
  Eigen::VectorXd x_, y_;  // the iterate, and the minimiser over the free variables (packed)
  Eigen::VectorXd inverse_pivot_;  // 1 / D of H = L D L' over the free variables (packed)
  Eigen::MatrixXd factor_;         // L below the diagonal, D L' above it
};

}  // namespace helix_arm::statics
