#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "helix_arm/calibration/calibration_parameters.hpp"
#include "helix_arm/statics/arm_model.hpp"

/// Shapes of arms as a function of the stiffness, for calibration.
namespace helix_arm::estimation {

/// All components of a stiffness.
struct Elasticity {
  model::Stiffness ratios;
  double K_eps = 0;  ///< [N]; 0 without load
};
/// @param entry  of the stiffness.
double& entryOf(Elasticity& elasticity, FitParameter entry);

/// The arms without captures, then each of them under what hangs on it in one of its captures.
std::vector<ArmCaptures> statesOf(const std::vector<ArmCaptures>& arms);

/// A shape and the derivatives of its pieces with respect to the parameters.
struct LinearisedShape {
  model::Shape shape;
  Eigen::MatrixXd by_stiffness, by_scale;  ///< (6 pieces x entries), with respect to logarithms
  // Filled by those who fit them: (6 pieces x actuators), (6 pieces x numbers of a FreeCurve).
  Eigen::MatrixXd by_stroke, by_curve;
  bool found = true;  ///< false: no shape balances the load
};

/// Shapes of all arms at a given stiffness, and their derivatives with respect to it: analytic
/// without load, central differences of solutions under load.
class ShapeModel {
 public:
  ShapeModel(const std::vector<ArmCaptures>& arms, const std::vector<FitParameter>& fitted);

  double referenceOf(FitParameter entry) const {
    Elasticity reference = reference_;
    return entryOf(reference, entry);
  }

  // The stiffness with the fitted entries multiplied by exp(logs). An entry that is 0 starts from
  // its reference. The other entries are unchanged.
  Elasticity elasticityAt(const double* logs, Elasticity elasticity) const;
  const Elasticity& initial() const { return initial_; }

  // Shape of arm `a` at these lengths and, if requested, its derivatives with respect to the
  // logarithms of the stiffness and of factors on the lengths: none, one for all, or one each.
  LinearisedShape at(int a, const Eigen::VectorXd& lengths, const double* logs, int scales = 0,
                     bool derivatives = false);

 private:
  struct Statics {
    statics::ArmModel model;
    bool too_steep;  // a taper, for this stiffness
  };
  // An arm at the logs and, under load, one step to either side of them.
  struct LinearisationPoint {
    std::optional<Statics> at;
    std::vector<Statics> above, below;  // [entry]
  };

  int size() const { return static_cast<int>(fitted_.size()); }

  Statics staticsAt(const ArmCaptures& data, const Eigen::VectorXd& logs) const;
  void update(const double* logs, bool derivatives);
  // Fill the derivatives of a shape, whose sizes are set, without load and under load.
  void differentiate(const model::Arm& arm, const Eigen::VectorXd& lengths,
                     LinearisedShape& out) const;
  void takeDifferences(const LinearisationPoint& arm, const Eigen::VectorXd& lengths,
                       LinearisedShape& out) const;

  const std::vector<ArmCaptures>& arms_;
  const std::vector<FitParameter> fitted_;
  Elasticity initial_, reference_;
  Eigen::VectorXd at_;
  bool has_changes_ = false;
  std::vector<LinearisationPoint> points_;  // [arm]
};

}  // namespace helix_arm::estimation
