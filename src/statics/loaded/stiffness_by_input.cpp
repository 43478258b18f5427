#include "helix_arm/statics/stiffness_by_input.hpp"

#include <string>

#include "buckling.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::statics {
namespace {

// @param inputOf  the input of an actuator.
template <class Group, class InputOf>
model::UnloadedOf<Group> withTables(const model::ArmOf<Group>& arm, const Load& load,
                                    const Eigen::VectorXd& lengths, const InputOf& inputOf) {
  model::UnloadedOf<Group> out = arm.unloadedOfLengths(lengths);
  out.compliance.resize(Group::kDof, Group::kDof * arm.sectionCount());
  Eigen::VectorXd factor = Eigen::VectorXd::Ones(arm.actuatorCount());
  for (int k = 0; k < arm.sectionCount(); ++k) {
    auto compliance = out.compliance.template middleCols<Group::kDof>(Group::kDof * k);
    const bool has_table = !load.tables.empty() && !load.tables[k].empty();
    if (!has_table && arm.bending(k).empty()) {
      compliance = complianceOf(arm, load, k);
      continue;
    }
    const int begin = arm.firstActuator(k), end = arm.firstActuator(k + 1);
    Eigen::VectorXd inputs(end - begin);
    for (int i = begin; i < end; ++i) {
      inputs[i - begin] = inputOf(i);
      if (has_table) factor[i] = load.tables[k].at(inputs[i - begin]);
    }
    const model::BendingTable& table = arm.bending(k);
    const auto at = arm.balance(k, lengths, table.at(table.argumentAt(inputs)), &factor);
    out.twists.col(k) = at.twist;
    compliance = arm.freeLength(k) / load.K_eps[k] * at.compliance;
  }
  return out;
}

}  // namespace

template <class Group>
model::UnloadedOf<Group> unloadedUnder(const model::ArmOf<Group>& arm, const Load& load,
                                       const model::InputRef& q) {
  if (!readsInputs(arm, &load)) return arm.unloaded(q);
  return withTables(arm, load, arm.lengths(q), [&q](int i) { return q[i]; });
}

template <class Group>
model::UnloadedOf<Group> unloadedUnderOfLengths(const model::ArmOf<Group>& arm, const Load& load,
                                                const Eigen::VectorXd& lengths) {
  if (!readsInputs(arm, &load)) return arm.unloadedOfLengths(lengths);
  return withTables(arm, load, lengths,
                    [&](int i) { return model::nearestInput(arm.actuator(i), lengths[i]).q; });
}

template <class Group>
void requireTables(const model::ArmOf<Group>& arm, const Load& load) {
  for (int k = 0; k < arm.sectionCount() && !load.tables.empty(); ++k) {
    if (load.tables[k].empty()) continue;
    const std::string who =
        "K_eps of section " + std::to_string(k + 1) + " depends on pressure, which needs ";
    const char* const need = arm.needForTables(k);
    if (need != nullptr) throw basics::Requirement("load", who + need);
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
