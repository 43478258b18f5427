#include "relaxation.hpp"

#include <Eigen/Cholesky>
#include <algorithm>

namespace helix_arm::statics {
namespace {

constexpr double kRidge = 1e-12;  // relative to memories of unit length; for nearly parallel ones

}  // namespace

template <int kMost>
double Anderson<kMost>::advance(Values x, const Eigen::Ref<const Eigen::VectorXd>& answer) {
  Stack change = weight_.cwiseProduct(answer - x);
  const double largest = change.template lpNorm<Eigen::Infinity>();
  const int kept = std::min(calls_, kDepth);
  x = answer;
  if (kept > 0) {
    const int newest = (calls_ - 1) % kDepth;
    changes_.col(newest) = change - last_change_;
    answers_.col(newest) = answer - last_answer_;
    for (int i = 0; i < kept; ++i) {
      gram_(i, newest) = gram_(newest, i) = changes_.col(i).dot(changes_.col(newest));
    }
    using Matrix =
        Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kDepth, kDepth>;
    using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kDepth, 1>;
    Matrix G = gram_.topLeftCorner(kept, kept);
    // Memories differ widely in size, so each is scaled to unit length.
    const Vector unit = G.diagonal().cwiseSqrt().cwiseMax(1e-300).cwiseInverse();
    Vector right(kept);
    for (int i = 0; i < kept; ++i) right[i] = unit[i] * changes_.col(i).dot(change);
    for (int i = 0; i < kept; ++i) {
      for (int j = 0; j < kept; ++j) G(i, j) *= unit[i] * unit[j];
      G(i, i) += kRidge;
    }
    const Vector share = Eigen::LDLT<Matrix>(G).solve(right);
    for (int i = 0; i < kept; ++i) x -= share[i] * unit[i] * answers_.col(i);
  }
  last_answer_ = answer;
  last_change_ = change;
  ++calls_;
  return largest;
}

template class Anderson<kMaxRates<3>>;
template class Anderson<kMaxRates<6>>;
template class Anderson<kMaxFineRates<3>>;
template class Anderson<kMaxFineRates<6>>;

}  // namespace helix_arm::statics
