#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "twist_equations.hpp"

namespace helix_arm::estimation {
namespace {

// Tip of the shape seen from B0 after a step of the twists, followed by the base if it is free.
Eigen::Vector3d tipAfter(const lie::SE3& X_B0B, const model::Shape& shape, bool free_base,
                         const Eigen::Ref<const Eigen::VectorXd>& step) {
  const int sections = shape.sectionCount(), per_section = shape.piecesPerSection();
  lie::SE3 X = X_B0B;
  if (free_base) X = X * lie::SE3::exp(lie::Vector6(step.segment<6>(6 * sections)));
  for (int j = 0; j < sections * per_section; ++j) {
    const int k = j / per_section;
    const lie::Vector6 change = step.segment<6>(6 * k) / per_section;
    X = X * lie::SE3::exp(lie::Vector6(shape.pieces().col(j) + change));
    if (shape.links() && (j + 1) % per_section == 0) X = X * (*shape.links())[k];
  }
  return X.translation;
}

}  // namespace

Eigen::Matrix3d tipCovarianceOf(const lie::SE3& X_B0B, const model::Shape& shape, bool free_base,
                                const Eigen::Ref<const Eigen::MatrixXd>& covariance) {
  const int sections = shape.sectionCount(), per_section = shape.piecesPerSection();
  TagRows<3> rows;
  rows.by_v.setIdentity();
  rows.by_w = -lie::skew((X_B0B * model::tipPose(shape)).translation);
  const int size = static_cast<int>(covariance.rows());
  Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, kMaxParameters> J(3, size);
  J.setZero();
  lie::SE3 X_B0j = X_B0B;
  for (int k = 0; k < sections; ++k) {
    PointJacobian jacobian;
    for (int j = k * per_section; j < (k + 1) * per_section; ++j) {
      jacobian += PointJacobian(X_B0j, shape.pieces().col(j), 1.0);
      X_B0j = shape.beyond(X_B0j, j);
    }
    jacobian *= 1.0 / per_section;
    jacobian.fill(rows, 6 * k, J);
  }
  if (free_base) PointJacobian(X_B0B).fill(rows, 6 * sections, J);
  Eigen::Matrix3d out = Eigen::Matrix3d::Zero();
  for (int column = 0; column < size; ++column) {
    const Eigen::Vector3d moved = J.lazyProduct(covariance.col(column));
    out.noalias() += moved * J.col(column).transpose();
  }
  return out;
}

Eigen::Matrix3d tipCurvatureOf(const lie::SE3& X_B0B, const model::Shape& shape, bool free_base,
                               const Eigen::Ref<const Eigen::MatrixXd>& covariance) {
  const Eigen::SelfAdjointEigenSolver<NormalEquations::Matrix> principal(covariance);
  const Eigen::Vector3d tip = (X_B0B * model::tipPose(shape)).translation;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  for (int i = 0; i < static_cast<int>(covariance.cols()); ++i) {
    const NormalEquations::Vector step =
        std::sqrt(std::max(0.0, principal.eigenvalues()[i])) * principal.eigenvectors().col(i);
    const NormalEquations::Vector back = -step;  // a Ref of an expression would be on the heap
    const Eigen::Vector3d even =
        0.5 * (tipAfter(X_B0B, shape, free_base, step) + tipAfter(X_B0B, shape, free_base, back)) -
        tip;
    sum += even;
    squares += even * even.transpose();
  }
  return sum * sum.transpose() + 2.0 * squares;
}

Eigen::Matrix3d tipCovariance(const model::Shape& shape, const Eigen::MatrixXd& covariance) {
  return tipCovarianceOf({}, shape, false, covariance);
}

}  // namespace helix_arm::estimation
