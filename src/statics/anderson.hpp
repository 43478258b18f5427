#pragma once

#include <Eigen/Core>

namespace helix_arm::statics {

/// Anderson's acceleration of a fixed-point iteration x = F(x): the next x is the combination of
/// the last values F(x) whose changes F(x) - x cancel best (least squares).
///
/// @tparam kMost  maximum number of entries of x; nothing is allocated.
template <int kMost>
class Anderson {
 public:
  using Values = Eigen::Ref<Eigen::VectorXd>;

  /// @param weight  (n) weight of each entry in the least squares.
  explicit Anderson(const Eigen::Ref<const Eigen::VectorXd>& weight) : weight_(weight) {
    for (Memory* memory : {&changes_, &answers_}) memory->resize(weight.size(), kDepth);
  }

  /// Adds x and F(x), (n) each, and replaces x by the next iterate.
  /// @return the largest entry of the weighted change F(x) - x, for the old x.
  double advance(Values x, const Eigen::Ref<const Eigen::VectorXd>& answer);

 private:
  static constexpr int kDepth = 5;
  using Stack = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMost, 1>;
  using Memory = Eigen::Matrix<double, Eigen::Dynamic, kDepth, Eigen::ColMajor, kMost, kDepth>;

  Stack weight_, last_answer_, last_change_;
  Memory changes_, answers_;                    // differences of consecutive values
  Eigen::Matrix<double, kDepth, kDepth> gram_;  // of the changes
  int calls_ = 0;
};

}  // namespace helix_arm::statics
