#pragma once

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

/// Eigenvalues of a map in a Krylov space (Arnoldi), by finite differences of the map.
namespace helix_arm::statics::krylov {

inline constexpr int kDimensions = 8;  // dimension of the Krylov space
inline constexpr double kStep = 1e-6;  // difference step, relative to the arm's size and one radian

using Projection = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor,
                                 kDimensions + 1, kDimensions + 1>;

/// Real parts of eigenvalues.
struct Range {
  double least, largest;
};

/// Those of H; the largest is infinite if H is not finite.
inline Range eigenvalues(const Projection& H) {
  if (!H.allFinite()) return {0.0, std::numeric_limits<double>::infinity()};
  const auto real = Eigen::EigenSolver<Projection>(H, false).eigenvalues().real().eval();
  return {real.minCoeff(), real.maxCoeff()};
}

/// The same for the derivative of a map, in the Krylov space of a start vector with components in
/// all entries. Allocates nothing except for the eigenvalues.
///
/// @tparam kMostSize  maximum of `size`.
/// @param size  number of entries of a motion.
/// @param respond  respond(motion, change) sets `change` (size) to the derivative's product with a
///     unit vector `motion` (size), by a difference of kStep.
template <int kMostSize, class Respond>
Range eigenvalues(int size, const Respond& respond) {
  using Basis = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMostSize,
                              kDimensions + 1>;
  int count = std::min(kDimensions, size);
  Basis basis(size, count + 1);
  for (int i = 0; i < size; ++i) basis(i, 0) = std::sin(1.0 + 2.0 * i * i);
  basis.col(0).normalize();
  Projection H = Projection::Zero(count + 1, count + 1);
  for (int j = 0; j < count; ++j) {
    auto next = basis.col(j + 1);
    respond(basis.col(j), next);
    for (int i = 0; i <= j; ++i) {
      H(i, j) = basis.col(i).dot(next);
      next -= H(i, j) * basis.col(i);
    }
    H(j + 1, j) = next.norm();
    if (!(H(j + 1, j) > kStep)) count = j + 1;
    next /= H(j + 1, j);
  }
  return eigenvalues(H.topLeftCorner(count, count));
}

}  // namespace helix_arm::statics::krylov
