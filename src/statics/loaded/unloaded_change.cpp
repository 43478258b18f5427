#include "helix_arm/statics/unloaded_change.hpp"

#include "helix_arm/model/taper.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"

namespace helix_arm::statics {
namespace {

// A motion that costs less than this fraction of another one is free of cost.
constexpr double kFreeOfCost = 1e-9;
constexpr int kBending = 2;  // among the components of a stiffness

// The entries of K that belong to one component of a stiffness, as a diagonal.
template <class Group>
typename Group::Tangent entriesOf(int component) {
  model::Stiffness unit{0.0, 0.0, 0.0};
  (component == 0 ? unit.gamma : component == kBending ? unit.kappa : unit.tau) = 1.0;
  typename Group::Tangent out = unit.diagonal<Group>();
  out[0] = 0.0;  // K is normalised by it
  return out;
}

}  // namespace

template <class Group>
ActuatorChange<Group>::ActuatorChange(const model::ArmOf<Group>& arm, const Load* load,
                                      const Eigen::VectorXd& lengths, By by)
    : arm_(arm),
      load_(load),
      lengths_(lengths),
      per_actuator_(by == By::kLengths ? 1 : 1 + kEntries),
      factors_(static_cast<std::size_t>(arm.actuatorCount())),
      bending_(static_cast<std::size_t>(arm.sectionCount()), {1.0, {}}),
      jumps_(static_cast<std::size_t>(arm.actuatorCount())) {
  const model::UnloadedOf<Group> unloaded = arm.unloadedOfLengths(lengths);
  to_actuator_.reserve(static_cast<std::size_t>(arm.actuatorCount()));
  compliance_.reserve(static_cast<std::size_t>(arm.sectionCount()));
  constant_.reserve(static_cast<std::size_t>(arm.sectionCount()));
  for (int i = 0; i < arm.actuatorCount(); ++i) to_actuator_.push_back(toActuatorAt(i, 0.0));
  for (int k = 0; k < arm.sectionCount(); ++k) {
    setJumps(k);
    compliance_.push_back(arm.equilibrium(k).compliance);
    constant_.emplace_back();
    if (arm.taper(k)) continue;
    const int count = arm.firstActuator(k + 1) - arm.firstActuator(k);
    Motion strains(Group::kDof, count);
    Motion by_lengths = arm.equilibrium(k).map;
    Tangent twist = unloaded.twists.col(k);
    if (varies(k)) {
      const auto at = balanceOf(k);
      compliance_[k] = at.compliance;
      twist = at.twist;
    }
    for (int j = 0; j < count; ++j) {
      const int i = arm.firstActuator(k) + j;
      const Matrix& to = to_actuator_[i];
      strains.col(j) = lengths[i] * Tangent::Unit(0) - to * twist;
      if (varies(k)) {
        by_lengths.col(j) = compliance_[k] * (factors_[i].value * to.row(0).transpose());
      }
    }
    constant_[k] = compliance_[k] * forces(k, 0.0, strains);
    constant_[k].leftCols(count) += by_lengths;
  }
}

template <class Group>
typename model::ArmOf<Group>::Balance ActuatorChange<Group>::balanceOf(int k) {
  Eigen::VectorXd values = Eigen::VectorXd::Ones(arm_.actuatorCount());
  for (int i = arm_.firstActuator(k); hasTable(k) && i < arm_.firstActuator(k + 1); ++i) {
    const StiffnessTable& table = load_->tables[k];
    // Beyond its limits an actuator is as stiff as there.
    const auto [q, inside] = model::nearestInput(arm_.actuator(i), lengths_[i]);
    factors_[i].value = values[i] = table.at(q);
    if (inside) factors_[i].slope = table.slopeAt(q) / arm_.actuator(i).contraction.slopeInside(q);
  }
  if (!arm_.bending(k).empty()) bending_[k] = arm_.bendingOfLengths(lengths_, k);
  return arm_.balance(k, lengths_, bending_[k].factor, &values);
}

template <class Group>
typename ActuatorChange<Group>::Matrix ActuatorChange<Group>::toActuatorAt(int i, double s) const {
  return model::poseAlong(arm_.actuator(i), s).inverse().adjoint();
}

template <class Group>
typename ActuatorChange<Group>::Matrix ActuatorChange<Group>::toActuator(int k, int i,
                                                                         double s) const {
  return arm_.taper(k) ? toActuatorAt(i, s) : to_actuator_[i];
}

template <class Group>
typename ActuatorChange<Group>::Matrix ActuatorChange<Group>::compliance(int k, double s) const {
  return arm_.taper(k) ? arm_.taper(k)->complianceAt(s) : compliance_[k];
}

template <class Group>
int ActuatorChange<Group>::stiffnessColumn(int k, int actuator, int component) const {
  const int begin = arm_.firstActuator(k), count = arm_.firstActuator(k + 1) - begin;
  return first(k) + count + kEntries * (actuator - begin) + component;
}

template <class Group>
void ActuatorChange<Group>::setJumps(int k) {
  const auto& null_space = arm_.equilibrium(k).null_space;
  if (null_space.cols() == 0) return;
  for (int i = arm_.firstActuator(k); i < arm_.firstActuator(k + 1); ++i) {
    for (int component = 0; component < kEntries; ++component) {
      const Motion cost = entriesOf<Group>(component).asDiagonal() * (to_actuator_[i] * null_space);
      jumps_[i][component] = cost.cwiseAbs().maxCoeff() > kFreeOfCost;
    }
  }
}

template <class Group>
typename ActuatorChange<Group>::Motion ActuatorChange<Group>::forces(int k, double s,
                                                                     const Motion& strains) const {
  Motion out = Motion::Zero(Group::kDof, columns(k));
  const double bending = bending_[k].factor;
  Tangent by_bending = Tangent::Zero();
  for (int j = 0; j < strains.cols(); ++j) {
    const int i = arm_.firstActuator(k) + j;
    const Factor& factor = factors_[i];
    const Matrix to = toActuator(k, i, s);
    model::Stiffness stiffness = arm_.actuator(i).stiffness;
    by_bending += factor.value * (to.transpose() *
                                  stiffness.bending<Group>().cwiseProduct(Tangent(strains.col(j))));
    stiffness.kappa *= bending;
    const Tangent K = stiffness.diagonal<Group>();
    if (factor.slope != 0) {
      out.col(j) = factor.slope * (to.transpose() * K.cwiseProduct(strains.col(j)));
    }
    for (int component = 0; per_actuator_ > 1 && component < kEntries; ++component) {
      if (jumps(i, component)) continue;
      const Tangent stress = entriesOf<Group>(component).cwiseProduct(strains.col(j));
      out.col(stiffnessColumn(k, i, component) - first(k)) =
          factor.value * (component == kBending ? bending : 1.0) * (to.transpose() * stress);
    }
  }
  if (!arm_.bending(k).empty()) {
    out.leftCols(strains.cols()) += by_bending * bending_[k].by_length.transpose();
  }
  return out;
}

template <class Group>
typename ActuatorChange<Group>::Motion ActuatorChange<Group>::twist(int k, double s) const {
  if (!arm_.taper(k)) return constant_[k];
  const auto map = arm_.taper(k)->mapAt(s);
  const int begin = arm_.firstActuator(k);
  Motion out = Motion::Zero(Group::kDof, columns(k));
  if (per_actuator_ > 1) {
    const Tangent g = map * lengths_.segment(begin, map.cols());
    Motion strains(Group::kDof, map.cols());
    for (int j = 0; j < map.cols(); ++j) {
      strains.col(j) = lengths_[begin + j] * Tangent::Unit(0) - toActuator(k, begin + j, s) * g;
    }
    out = compliance(k, s) * forces(k, s, strains);
  }
  out.leftCols(map.cols()) += map;
  return out;
}

template <class Group>
typename ActuatorChange<Group>::Motion ActuatorChange<Group>::strain(int k, double s,
                                                                     const Tangent& strain) const {
  const int begin = arm_.firstActuator(k), count = arm_.firstActuator(k + 1) - begin;
  if (per_actuator_ == 1 && !varies(k)) return Motion::Zero(Group::kDof, count);
  Motion strains(Group::kDof, count);
  for (int j = 0; j < count; ++j) strains.col(j) = -(toActuator(k, begin + j, s) * strain);
  return compliance(k, s) * forces(k, s, strains);
}

template <class Group>
TaperStep<Group> taperStep(const model::TaperTwist<Group>& profile,
                           const UnloadedChange<Group>& change, int k, double from, double to) {
  using Tangent = typename Group::Tangent;
  using Motion = typename UnloadedChange<Group>::Motion;
  const auto g = model::magnusTerms<Tangent>(from, to, profile.cells(), Tangent::Zero(),
                                             [&](double s) { return profile.at(s); });
  const auto by = model::magnusTerms<Motion>(from, to, profile.cells(),
                                             Motion::Zero(Group::kDof, change.columns(k)),
                                             [&](double s) { return change.twist(k, s); });
  return {model::magnusTwist(g), model::magnusSlope(g, by)};
}

template class ActuatorChange<lie::SE2>;
template class ActuatorChange<lie::SE3>;
template TaperStep<lie::SE2> taperStep(const model::TaperTwist<lie::SE2>&,
                                       const UnloadedChange<lie::SE2>&, int, double, double);
template TaperStep<lie::SE3> taperStep(const model::TaperTwist<lie::SE3>&,
                                       const UnloadedChange<lie::SE3>&, int, double, double);

}  // namespace helix_arm::statics
