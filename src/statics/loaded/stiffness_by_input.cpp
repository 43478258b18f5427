#include "helix_arm/statics/stiffness_by_input.hpp"

#include <Eigen/Cholesky>
#include <algorithm>

#include "buckling.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::statics {
namespace {

// Of A, scaled to lengths: its entries are sums, which lose half the digits that a stack keeps.
constexpr double kWorstCondition = 1e9;

template <class Group>
void addSection(const model::ArmOf<Group>& arm, const Load& load, const Eigen::VectorXd& factor,
                const Eigen::VectorXd& lengths, int k, model::UnloadedOf<Group>& out) {
  using Tangent = typename Group::Tangent;
  using Matrix = typename Group::Matrix;
  double offset = 0.0;
  for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
    offset = std::max(offset, arm.actuator(i).X_O.translation.norm());
  }
  // Angles are scaled to arc lengths, so that bending is not mistaken for noise.
  Tangent S = Tangent::Ones();
  if (offset > 0) S.template tail<Group::kRotations>().setConstant(1.0 / offset);
  Matrix A = Matrix::Zero();
  Tangent D_l = Tangent::Zero();
  for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
    const model::ActuatorOf<Group>& actuator = arm.actuator(i);
    const Matrix M = actuator.X_O.inverse().adjoint() * S.asDiagonal();
    const Tangent K = factor[i] * actuator.stiffness.template diagonal<Group>();
    A += M.transpose() * K.asDiagonal() * M;
    D_l += K[0] * lengths[i] * M.row(0).transpose();
  }
  const Eigen::LDLT<Matrix> factors(A);
  out.twists.col(k) = S.cwiseProduct(Tangent(factors.solve(D_l)));
  out.compliance.template middleCols<Group::kDof>(Group::kDof * k) =
      arm.freeLength(k) / load.K_eps[k] * (S.asDiagonal() * factors.solve(Matrix(S.asDiagonal())));
}

// @param inputOf  the input of an actuator.
template <class Group, class InputOf>
model::UnloadedOf<Group> withTables(const model::ArmOf<Group>& arm, const Load& load,
                                    const Eigen::VectorXd& lengths, const InputOf& inputOf) {
  model::UnloadedOf<Group> out = arm.unloadedOfLengths(lengths);
  out.compliance.resize(Group::kDof, Group::kDof * arm.sectionCount());
  Eigen::VectorXd factor(arm.actuatorCount());
  for (int k = 0; k < arm.sectionCount(); ++k) {
    if (load.tables[k].empty()) {
      out.compliance.template middleCols<Group::kDof>(Group::kDof * k) = complianceOf(arm, load, k);
      continue;
    }
    for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
      factor[i] = load.tables[k].at(inputOf(i));
    }
    addSection(arm, load, factor, lengths, k, out);
  }
  return out;
}

}  // namespace

template <class Group>
model::UnloadedOf<Group> unloadedUnder(const model::ArmOf<Group>& arm, const Load& load,
                                       const model::InputRef& q) {
  if (load.tables.empty()) return arm.unloaded(q);
  return withTables(arm, load, arm.lengths(q), [&q](int i) { return q[i]; });
}

template <class Group>
model::UnloadedOf<Group> unloadedUnderOfLengths(const model::ArmOf<Group>& arm, const Load& load,
                                                const Eigen::VectorXd& lengths) {
  if (load.tables.empty()) return arm.unloadedOfLengths(lengths);
  return withTables(arm, load, lengths,
                    [&](int i) { return nearestInput(arm.actuator(i), lengths[i]).q; });
}

template <class Group>
void requireTables(const model::ArmOf<Group>& arm, const Load& load) {
  for (int k = 0; k < arm.sectionCount() && !load.tables.empty(); ++k) {
    if (load.tables[k].empty()) continue;
    const std::string who =
        "K_eps of section " + std::to_string(k + 1) + " depends on pressure, which needs ";
    basics::requireKey(!arm.taper(k), "load", who, "a section without taper");
    basics::requireKey(arm.equilibrium(k).rank == Group::kDof, "load", who,
                       "stiffness against every motion; give K_tau_m2 and K_kappa_m2 values > 0");
    basics::requireKey(arm.equilibrium(k).condition <= kWorstCondition, "load", who,
                       "shear and bending of comparable stiffness; lower K_gamma");
  }
}

template model::UnloadedOf<lie::SE2> unloadedUnder(const model::PlanarArm&, const Load&,
                                                   const model::InputRef&);
template model::UnloadedOf<lie::SE3> unloadedUnder(const model::Arm&, const Load&,
                                                   const model::InputRef&);
template model::UnloadedOf<lie::SE2> unloadedUnderOfLengths(const model::PlanarArm&, const Load&,
                                                            const Eigen::VectorXd&);
template model::UnloadedOf<lie::SE3> unloadedUnderOfLengths(const model::Arm&, const Load&,
                                                            const Eigen::VectorXd&);
template void requireTables(const model::PlanarArm&, const Load&);
template void requireTables(const model::Arm&, const Load&);

}  // namespace helix_arm::statics
