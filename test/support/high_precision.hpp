#pragma once

#include <limits>

#include <boost/multiprecision/eigen.hpp>
#include <boost/multiprecision/mpfr.hpp>

#include "helix_arm/lie/se2.hpp"
namespace helix_arm::test {

using Real = boost::multiprecision::number<boost::multiprecision::mpfr_float_backend<80>,
                                           boost::multiprecision::et_off>;
using RealMatrix = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic>;

inline constexpr double kEps = std::numeric_limits<double>::epsilon();

/// Largest entry of |a - b|, in units of eps.
template <class A, class B>
double worstEps(const Eigen::MatrixBase<A>& a, const Eigen::MatrixBase<B>& b) {
  return static_cast<double>(
      Real((a.template cast<Real>() - b.template cast<Real>()).cwiseAbs().maxCoeff() / kEps));
}

/// |a - b| / |b|, in units of eps.
template <class A, class B>
double relativeEps(const Eigen::MatrixBase<A>& a, const Eigen::MatrixBase<B>& b) {
  const RealMatrix reference = b.template cast<Real>();
  const RealMatrix difference = a.template cast<Real>() - reference;
  return static_cast<double>(Real(difference.norm() / reference.norm() / kEps));
}

/// Homogeneous matrix of a twist's algebra element.
inline RealMatrix hat(const lie::SE3::Tangent& xi) {
  RealMatrix M = RealMatrix::Zero(4, 4);
  M.topLeftCorner(3, 3) = lie::skew(xi.tail<3>()).cast<Real>();
  M.topRightCorner(3, 1) = xi.head<3>().cast<Real>();
  return M;
}
inline RealMatrix hat(const lie::SE2::Tangent& xi) {
  RealMatrix M = RealMatrix::Zero(3, 3);
  M(0, 1) = -Real(xi[2]);
  M(1, 0) = Real(xi[2]);
  M(0, 2) = xi[0];
  M(1, 2) = xi[1];
  return M;
}

/// ad of a twist: ad(xi) eta = [xi, eta].
inline RealMatrix ad(const lie::SE3::Tangent& xi) {
  RealMatrix M = RealMatrix::Zero(6, 6);
  M.topLeftCorner(3, 3) = M.bottomRightCorner(3, 3) = lie::skew(xi.tail<3>()).cast<Real>();
  M.topRightCorner(3, 3) = lie::skew(xi.head<3>()).cast<Real>();
  return M;
}
inline RealMatrix ad(const lie::SE2::Tangent& xi) {
  RealMatrix M = RealMatrix::Zero(3, 3);
  M(0, 1) = -Real(xi[2]);
  M(1, 0) = Real(xi[2]);
  M(0, 2) = xi[1];
  M(1, 2) = -Real(xi[0]);
  return M;
}

/// sum_n M^n / (n + first)!, by its definition. Digits are lost like e^|M|: for |M| up to about 50.
inline RealMatrix factorialSum(const RealMatrix& M, int first) {
  RealMatrix sum = RealMatrix::Zero(M.rows(), M.cols()),
             term = RealMatrix::Identity(M.rows(), M.cols());
  for (int k = 2; k <= first; ++k) term /= Real(k);
  for (int n = 1; n < 400; ++n) {
    sum += term;
    if (term.cwiseAbs().maxCoeff() < sum.cwiseAbs().maxCoeff() * Real("1e-85")) break;
    term = (term * M / Real(n + first)).eval();
  }
  return sum;
}

/// exp(M), by its series after halving and with squaring.
inline RealMatrix expOfMatrix(const RealMatrix& M) {
  int halvings = 0;
  Real size = M.cwiseAbs().maxCoeff();
  for (; size > Real(0.5); size /= 2) ++halvings;
  RealMatrix X = factorialSum(M / boost::multiprecision::pow(Real(2), halvings), 0);
  for (int i = 0; i < halvings; ++i) X = (X * X).eval();
  return X;
}

/// Left Jacobian, sum_n ad^n / (n + 1)!.
template <class Tangent>
RealMatrix leftJacobianByDefinition(const Tangent& xi) {
  return factorialSum(ad(xi), 1);
}

}  // namespace helix_arm::test
