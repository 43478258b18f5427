#include "helix_arm/model/equilibrium.hpp"

#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/lie/se2.hpp"
#include "helix_arm/lie/se3.hpp"

namespace helix_arm::model {
namespace {

template <class Group>
void checkElements(const std::vector<ActuatorElement<Group>>& elements) {
  basics::require(!elements.empty() && elements.size() <= kMaxActuators, "a section has ",
                  elements.size(), " actuators; expected 1 to ", kMaxActuators);
  for (std::size_t i = 0; i < elements.size(); ++i) {
    const auto& [X_O, K] = elements[i];
    basics::require(X_O.rotation.allFinite() && X_O.translation.allFinite(), "actuator ", i + 1,
                    " has a pose that is not finite");
    basics::require(K.allFinite() && (K.array() >= 0).all() && K[0] > 0, "actuator ", i + 1,
                    " has a stiffness that is not finite and >= 0, or no extensional stiffness");
  }
}

// Length that scales bending against shear: distance of the actuators from the base curve or, if
// this vanishes, that which corresponds to their own bending stiffness.
template <class Group>
double characteristicLength(const std::vector<ActuatorElement<Group>>& elements) {
  double offset = 0.0, bending = 0.0;
  for (const auto& [X_O, K] : elements) {
    offset += X_O.translation.squaredNorm() / static_cast<double>(elements.size());
    bending = std::max(bending, K.template tail<Group::kRotations>().maxCoeff());
  }
  const double length = std::max(std::sqrt(offset), 1e-6 * std::sqrt(bending));
  return length > 0 ? length : 1.0;
}

// Rows K_i^1/2 Ad_oi^-1 S^-1 of all elements, and K_i^1/2 e1 by their free lengths.
struct ElementRows {
  Eigen::MatrixXd by_twist, by_length;
};

// Largest rows first: with column pivoting, small rows keep their digits if K_gamma >> K_kappa.
template <class Group>
ElementRows sortedRows(const std::vector<ActuatorElement<Group>>& elements,
                       const typename Group::Tangent& S_inverse) {
  constexpr int dof = Group::kDof;
  const int n = static_cast<int>(elements.size());
  Eigen::MatrixXd stack(n * dof, dof);
  for (int i = 0; i < n; ++i) {
    const auto& [X_O, K] = elements[i];
    stack.middleRows<dof>(i * dof) =
        K.cwiseSqrt().asDiagonal() * X_O.inverse().adjoint() * S_inverse.asDiagonal();
  }
  std::vector<int> order(n * dof);
  std::iota(order.begin(), order.end(), 0);
  const Eigen::VectorXd size = stack.rowwise().template lpNorm<Eigen::Infinity>();
  std::stable_sort(order.begin(), order.end(), [&size](int a, int b) { return size[a] > size[b]; });
  ElementRows out{Eigen::MatrixXd(n * dof, dof), Eigen::MatrixXd::Zero(n * dof, n)};
  for (int row = 0; row < n * dof; ++row) {
    out.by_twist.row(row) = stack.row(order[row]);
    const int i = order[row] / dof;
    if (order[row] % dof == 0) out.by_length(row, i) = std::sqrt(elements[i].K[0]);
  }
  return out;
}

}  // namespace

template <class Group>
Equilibrium<Group> solveEquilibrium(const std::vector<ActuatorElement<Group>>& elements) {
  constexpr int dof = Group::kDof;
  checkElements(elements);
  const int n = static_cast<int>(elements.size());

  // Unknowns S g: with angles scaled to arc lengths, all are lengths, and bending is no noise.
  typename Group::Tangent S_inverse = Group::Tangent::Ones();
  S_inverse.template tail<Group::kRotations>().setConstant(1.0 / characteristicLength(elements));

  const auto [sorted, rest_length] = sortedRows(elements, S_inverse);

  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(sorted);
  const int rank = static_cast<int>(qr.rank());
  const Eigen::MatrixXd R = qr.matrixR().topRows(dof).template triangularView<Eigen::Upper>();
  const auto R11 = R.topLeftCorner(rank, rank).template triangularView<Eigen::Upper>();
  Eigen::MatrixXd permuted = Eigen::MatrixXd::Zero(dof, n);
  permuted.topRows(rank) = R11.solve((qr.householderQ().adjoint() * rest_length).topRows(rank));

  Equilibrium<Group> result;
  result.rank = rank;
  result.map = S_inverse.asDiagonal() * (qr.colsPermutation() * permuted);
  Eigen::MatrixXd R11_inverse = Eigen::MatrixXd::Zero(dof, rank);
  R11_inverse.topRows(rank) = R11.solve(Eigen::MatrixXd::Identity(rank, rank));
  const Eigen::MatrixXd factor = S_inverse.asDiagonal() * (qr.colsPermutation() * R11_inverse);
  result.compliance = factor * factor.transpose();
  const Eigen::VectorXd sigma = Eigen::JacobiSVD<Eigen::MatrixXd>(R.topRows(rank)).singularValues();
  result.condition = std::pow(sigma[0] / sigma[rank - 1], 2);
  result.null_space.resize(dof, dof - rank);
  if (rank < dof) {
    Eigen::MatrixXd basis(dof, dof - rank);
    basis << -R11.solve(R.topRightCorner(rank, dof - rank)),
        Eigen::MatrixXd::Identity(dof - rank, dof - rank);
    basis = S_inverse.asDiagonal() * (qr.colsPermutation() * basis);
    const Eigen::HouseholderQR<Eigen::MatrixXd> orthonormal(basis);
    result.null_space = orthonormal.householderQ() * Eigen::MatrixXd::Identity(dof, dof - rank);
    // Least norm in the units of g, as the pseudo-inverse of eq. 17 means it.
    const typename Group::Matrix range =
        Group::Matrix::Identity() - result.null_space * result.null_space.transpose();
    result.map = (range * result.map).eval();
    result.compliance = (range * result.compliance * range).eval();
  }
  return result;
}

template Equilibrium<lie::SE2> solveEquilibrium(
    const std::vector<ActuatorElement<lie::SE2>>& elements);
template Equilibrium<lie::SE3> solveEquilibrium(
    const std::vector<ActuatorElement<lie::SE3>>& elements);

}  // namespace helix_arm::model
