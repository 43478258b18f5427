#pragma once

#include <Eigen/Core>
#include <vector>

#include "calibration_problem.hpp"

/// The shapes that arms have while a calibration searches for their stiffness.
namespace helix_arm::estimation {

/// The entry of a stiffness.
double& entryOf(model::Stiffness& stiffness, StiffnessEntry entry);

/// The linear maps of all arms at some stiffness, and how they change with it.
class ShapeModel {
 public:
  ShapeModel(const std::vector<ArmCaptures>& arms, const std::vector<StiffnessEntry>& fitted);

  double referenceOf(StiffnessEntry entry) const {
    model::Stiffness reference = reference_;
    return entryOf(reference, entry);
  }

  // With the fitted entries at these logs, the others as they are.
  model::Stiffness stiffnessAt(const double* logs, model::Stiffness stiffness) const;
  const model::Stiffness& initial() const { return initial_; }

  // Twists of arm `a` at these lengths, and, where asked for, their change with the logs.
  model::Twists twists(int a, const Eigen::VectorXd& lengths, const double* logs,
                       Eigen::MatrixXd* by_stiffness = nullptr);

  // The map of the section that an actuator belongs to, at the logs last seen.
  const Eigen::MatrixXd& mapOf(int a, int section) const { return maps_[a][section]; }

  static int count(const model::Arm& arm, int k) {
    return arm.firstActuator(k + 1) - arm.firstActuator(k);
  }

 private:
  using Maps = std::vector<std::vector<Eigen::MatrixXd>>;  // [arm][section]

  int size() const { return static_cast<int>(fitted_.size()); }

  Maps mapsAt(const Eigen::VectorXd& logs) const;

  void update(const double* logs, bool derivatives);

  const std::vector<ArmCaptures>& arms_;
  const std::vector<StiffnessEntry> fitted_;
  model::Stiffness initial_, reference_;
  Eigen::VectorXd at_;
  bool has_changes_ = false;
  Maps maps_;
  std::vector<std::vector<std::vector<Eigen::MatrixXd>>> changes_;  // [arm][section][entry]
};

}  // namespace helix_arm::estimation
