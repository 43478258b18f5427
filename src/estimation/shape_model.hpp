#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "helix_arm/estimation/calibration_parameters.hpp"
#include "helix_arm/statics/solution.hpp"

/// The shapes that arms have while a calibration searches for their stiffness.
namespace helix_arm::estimation {

/// All that a stiffness consists of.
struct Elasticity {
  model::Stiffness ratios;
  double K_eps = 0;  ///< [N]; 0 where nothing loads the arm
};
double& entryOf(Elasticity& elasticity, StiffnessEntry entry);

/// A shape that a cost sees, and how parameters change its pieces.
struct ShapeThere {
  model::Shape shape;
  Eigen::MatrixXd by_stiffness, by_scale;  ///< (6 pieces x entries), by logs
  bool found = true;                       ///< false: nothing holds the load
};

/// Shapes of all arms at some stiffness, and how they change with it: linear maps of the lengths,
/// or, where a load bends an arm, solutions and their central differences.
class ShapeModel {
 public:
  ShapeModel(const std::vector<ArmCaptures>& arms, const std::vector<StiffnessEntry>& fitted);

  double referenceOf(StiffnessEntry entry) const {
    Elasticity reference = reference_;
    return entryOf(reference, entry);
  }

  // With the fitted entries moved by these logs, from the reference where they are 0; the others as
  // they are.
  Elasticity elasticityAt(const double* logs, Elasticity elasticity) const;
  const Elasticity& initial() const { return initial_; }

  // Shape of arm `a` at these lengths, and, where asked for, its change with the logs of the
  // stiffness and of factors on the lengths: none, one for all, or one each.
  ShapeThere at(int a, const Eigen::VectorXd& lengths, const double* logs, int scales = 0,
                bool derivatives = false);

 private:
  using Maps = std::vector<std::vector<Eigen::MatrixXd>>;  // [arm][section]
  using Statics = std::function<statics::Solution(const Eigen::VectorXd& lengths)>;
  // Of a loaded arm, at the logs and a step to either side of them.
  struct Loaded {
    Statics there;
    std::vector<Statics> above, below;  // [entry]
    // The last one found: all tags of a capture ask for the same.
    Eigen::VectorXd lengths;
    bool has_changes = false;
    ShapeThere last;
  };

  int size() const { return static_cast<int>(fitted_.size()); }

  Maps mapsAt(const Eigen::VectorXd& logs) const;
  Statics staticsAt(const ArmCaptures& data, const Eigen::VectorXd& logs) const;

  void update(const double* logs, bool derivatives);
  ShapeThere unloaded(int a, const Eigen::VectorXd& lengths, int scales, bool derivatives) const;
  ShapeThere loaded(int a, const Eigen::VectorXd& lengths, int scales, bool derivatives);

  const std::vector<ArmCaptures>& arms_;
  const std::vector<StiffnessEntry> fitted_;
  Elasticity initial_, reference_;
  Eigen::VectorXd at_;
  bool has_changes_ = false;
  Maps maps_;
  std::vector<std::vector<std::vector<Eigen::MatrixXd>>> changes_;  // [arm][section][entry]
  std::vector<Loaded> loaded_;                                      // [arm]
};

}  // namespace helix_arm::estimation
