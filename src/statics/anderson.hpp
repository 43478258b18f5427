#pragma once

#include <Eigen/Core>

namespace helix_arm::statics {

/// Anderson's acceleration of a fixed-point iteration x = F(x): each next x is the combination of
/// the last answers F(x) whose changes F(x) - x cancel best (least squares).
///
/// @tparam kMost  most entries of x; nothing is allocated.
template <int kMost>
class Anderson {
 public:
  using Values = Eigen::Ref<Eigen::VectorXd>;

  /// @param weight  (n) of the entries in the least squares.
  explicit Anderson(const Eigen::Ref<const Eigen::VectorXd>& weight) : weight_(weight) {
    for (Memory* memory : {&changes_, &answers_}) memory->resize(weight.size(), kDepth);
  }

  /// Takes in x and its answer F(x), (n) each, and leaves the next x in x.
  /// @return the largest entry of the weighted change F(x) - x, from before.
  double advance(Values x, const Eigen::Ref<const Eigen::VectorXd>& answer);

 private:
  static constexpr int kDepth = 5;
  using Stack = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMost, 1>;
  using Memory = Eigen::Matrix<double, Eigen::Dynamic, kDepth, Eigen::ColMajor, kMost, kDepth>;

  Stack weight_, last_answer_, last_change_;
  Memory changes_, answers_;                    // differences of consecutive ones
  Eigen::Matrix<double, kDepth, kDepth> gram_;  // of the changes
  int calls_ = 0;
};

}  // namespace helix_arm::statics
