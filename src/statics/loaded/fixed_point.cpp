#include "fixed_point.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

namespace helix_arm::statics {

KrylovSpace::KrylovSpace(int size) : count_(std::min(kDimensions, size)) {
  basis_[0].resize(size);
  for (int i = 0; i < size; ++i) basis_[0][i] = std::sin(1.0 + 2.0 * i * i);
  basis_[0].normalize();
  H_.setZero();
}

void KrylovSpace::add(const Eigen::Ref<const Eigen::VectorXd>& image) {
  const int j = known_++;
  auto& next = basis_[known_];
  next = image;
  for (int i = 0; i <= j; ++i) {
    H_(i, j) = basis_[i].dot(next);
    next -= H_(i, j) * basis_[i];
  }
  H_(j + 1, j) = next.norm();
  if (!(H_(j + 1, j) > kInside)) count_ = known_;
  next /= H_(j + 1, j);
}

KrylovSpace::Range KrylovSpace::eigenvalues() const {
  using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kDimensions,
                               kDimensions>;
  const Matrix map = H_.topLeftCorner(count_, count_);
  Range out{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  if (!map.allFinite()) return {0.0, std::numeric_limits<double>::infinity()};
  // The map is upper Hessenberg by construction. EigenSolver would compile for seconds.
  Eigen::RealSchur<Matrix> schur(count_);
  schur.computeFromHessenberg(map, map, false);
  const Matrix& T = schur.matrixT();
  for (int i = 0; i < count_; ++i) {
    // A block of two that is not triangular has two conjugate eigenvalues.
    const bool first = i + 1 < count_ && T(i + 1, i) != 0, second = i > 0 && T(i, i - 1) != 0;
    const int other = first ? i + 1 : second ? i - 1 : i;
    const double real = 0.5 * (T(i, i) + T(other, other));
    out = {std::min(out.least, real), std::max(out.largest, real)};
  }
  return out;
}

Anderson::Anderson(const Eigen::Ref<const Eigen::VectorXd>& weight) : weight_(weight) {
  for (Memory* memory : {&changes_, &answers_}) memory->resize(weight.size(), kDepth);
}

double Anderson::advance(Values x, const Eigen::Ref<const Eigen::VectorXd>& answer) {
  Stack change = weight_.cwiseProduct(answer - x);
  const double largest = change.lpNorm<Eigen::Infinity>();
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

}  // namespace helix_arm::statics
