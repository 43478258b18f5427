#pragma once

#include <vector>

#include "gauss_rule.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "helix_arm/statics/unloaded_change.hpp"
#include "loaded_limits.hpp"

namespace helix_arm::statics {

/// The elements of an arm without load: poses seen from their starts, and compliance at the Gauss
/// points.
template <class Group>
template <int kNodes>
class LoadedArmOf<Group>::UnloadedElements {
 public:
  using Tangent = typename Group::Tangent;
  using Matrix = typename Group::Matrix;
  using Motion = typename UnloadedChange<Group>::Motion;

  /// Keeps references to the arm and to the unloaded state.
  UnloadedElements(const LoadedArmOf& arm, const Unloaded& unloaded)
      : arm_(arm), unloaded_(unloaded) {
    const GaussRule<kNodes>& rule = GaussRule<kNodes>::get();
    const int count = static_cast<int>(arm.elements_.size());
    if (arm.tapered_ || arm.has_tables_) compliance_.resize(kNodes * count);
    for (int e = 0; e < count; ++e) {
      const Element& element = arm.elements_[e];
      if (arm.tapers_[element.section]) {
        addTapered(e, rule);
        continue;
      }
      twist_[e] = element.length * unloaded.twists.col(element.section);
      for (int j = 0; j < kNodes; ++j) {
        const Group X = Group::exp(rule.nodes()[j] * twist_[e]);
        rotation_[e * kNodes + j] = X.rotation;
        translation_[e * kNodes + j] = X.translation;
        if (compliance_.empty()) continue;
        compliance_[e * kNodes + j] =
            arm.has_tables_ ? Matrix(unloaded.compliance.template middleCols<Group::kDof>(
                                  Group::kDof * element.section))
                            : arm.compliance_[element.section];
      }
    }
  }

  /// Twist over element e; of a tapered one, the sum of its steps.
  const Tangent& twist(int e) const { return twist_[e]; }
  Group atNode(int node) const { return {rotation_[node], translation_[node]}; }
  Group end(int e) const { return isTapered(e) ? end_[e] : Group::exp(twist_[e]); }
  /// At t in [0, 1] of element e.
  Group at(int e, double t) const {
    if (!isTapered(e)) return Group::exp(t * twist_[e]);
    const GaussRule<kNodes>& rule = GaussRule<kNodes>::get();
    const Element& element = arm_.elements_[e];
    Group X;
    double from = 0.0;
    for (int j = 0; j < kNodes && rule.nodes()[j] <= t; ++j) {
      X = atNode(e * kNodes + j);
      from = rule.nodes()[j];
    }
    return X * Group::exp(profileOf(element.section)
                              .step(element.begin + from * element.length,
                                    element.begin + t * element.length));
  }
  /// Motions (dof x m) of the poses at the nodes and at the end by parameters of the section, seen
  /// from the element's start.
  std::vector<Motion> changes(int e, const UnloadedChange<Group>& change) const {
    const GaussRule<kNodes>& rule = GaussRule<kNodes>::get();
    std::vector<Motion> out;
    for (int j = 0; j <= kNodes; ++j) {
      out.push_back(changeAt(e, j < kNodes ? rule.nodes()[j] : 1.0, j, change, out));
    }
    return out;
  }
  /// The same at t in [0, 1], from changes().
  Motion changeAt(int e, double t, const UnloadedChange<Group>& change,
                  const std::vector<Motion>& at_nodes) const {
    const GaussRule<kNodes>& rule = GaussRule<kNodes>::get();
    int before = 0;
    while (before < kNodes && rule.nodes()[before] <= t) ++before;
    return changeAt(e, t, before, change, at_nodes);
  }

  /// Twist per wrench, both seen from the node's frame.
  const Matrix& compliance(int e, int j) const {
    if (!compliance_.empty()) return compliance_[e * kNodes + j];
    return arm_.compliance_[arm_.elements_[e].section];
  }

 private:
  bool isTapered(int e) const {
    return arm_.tapered_ && arm_.tapers_[arm_.elements_[e].section] != nullptr;
  }

  model::TaperTwist<Group> profileOf(int section) const {
    const int first = arm_.first_[section];
    return {*arm_.tapers_[section],
            unloaded_.lengths.segment(first, arm_.first_[section + 1] - first)};
  }

  // At t, with `before` nodes before it.
  Motion changeAt(int e, double t, int before, const UnloadedChange<Group>& change,
                  const std::vector<Motion>& at_nodes) const {
    const Element& element = arm_.elements_[e];
    if (!isTapered(e)) {
      return Group::leftJacobian(t * twist_[e]) *
             (t * element.length * change.twist(element.section, 0.0));
    }
    const GaussRule<kNodes>& rule = GaussRule<kNodes>::get();
    const double from = before > 0 ? rule.nodes()[before - 1] : 0.0;
    const TaperStep<Group> step =
        taperStep(profileOf(element.section), change, element.section,
                  element.begin + from * element.length, element.begin + t * element.length);
    const Motion moved = Group::leftJacobian(step.twist) * step.by;
    if (before == 0) return moved;
    return at_nodes[before - 1] + atNode(e * kNodes + before - 1).adjoint() * moved;
  }

  // Magnus steps from Gauss point to Gauss point.
  void addTapered(int e, const GaussRule<kNodes>& rule) {
    const Element& element = arm_.elements_[e];
    const model::TaperTwist<Group> profile = profileOf(element.section);
    Group X;
    double from = element.begin;
    twist_[e].setZero();
    for (int j = 0; j <= kNodes; ++j) {
      const double to = element.begin + (j < kNodes ? rule.nodes()[j] : 1.0) * element.length;
      const Tangent step = profile.step(from, to);
      twist_[e] += step;
      X = X * Group::exp(step);
      from = to;
      if (j == kNodes) break;
      rotation_[e * kNodes + j] = X.rotation;
      translation_[e * kNodes + j] = X.translation;
      compliance_[e * kNodes + j] =
          arm_.per_K_[element.section] * arm_.tapers_[element.section]->complianceAt(to);
    }
    end_[e] = X;
  }

  const LoadedArmOf& arm_;
  const Unloaded& unloaded_;
  Tangent twist_[kMaxElements];
  decltype(Group::rotation) rotation_[kNodes * kMaxElements];
  typename Group::Point translation_[kNodes * kMaxElements];
  Group end_[kMaxElements];         // of tapered elements
  std::vector<Matrix> compliance_;  // at the nodes, if it is not one constant per section
};

}  // namespace helix_arm::statics
