#pragma once

#include <Eigen/Core>
#include <optional>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/statics/arm_model.hpp"

namespace helix_arm::statics {

/// How an arm differs from its model: its mean twists are G(l; factors) + offset, where G is the
/// model with other stiffness and other free lengths.
struct Correction {
  /// No difference.
  explicit Correction(const model::Arm& arm);

  model::Twists offset;  ///< (6 x sections) v [m], w [rad]
  /// Factors on the stiffness of every actuator, entry by entry, > 0.
  model::Stiffness stiffness_factors;
  double K_eps_factor = 1.0;     ///< > 0; no effect on an arm without load
  Eigen::VectorXd length_scale;  ///< (n) factors on the free lengths, > 0
  Eigen::VectorXd length_shift;  ///< (n) added to the scaled free lengths [m]
};

/// A model with a correction.
///
/// Lengths given to it are free lengths of the uncorrected actuators, so that the limits of the
/// inputs remain the same box.
class CorrectedModel {
 public:
  /// Starts without a difference.
  explicit CorrectedModel(const ArmModel& model);

  /// Replaces the correction. Allocates only if the factors on the stiffness change, or under load.
  /// @throws std::invalid_argument naming the value that is not finite, not > 0 or of another size.
  void set(const Correction& correction);

  const Correction& correction() const { return correction_; }
  /// The model with the corrected stiffness; actuators and limits are those of the nominal arm.
  /// Linear models are without load and in space.
  const ArmModel& model() const { return model_; }
  const model::Arm& arm() const { return model_.arm(); }

  /// Corrected free lengths (n) [m], valid until the next call.
  const Eigen::VectorXd& scaled(const Eigen::VectorXd& lengths) const noexcept;
  /// Shape at lengths (n) [m]; nothing if no shape balances the load. Does not allocate without
  /// load.
  std::optional<model::Shape> shape(const Eigen::VectorXd& lengths) const;
  /// Tip at lengths (n) [m] and its derivative (6 x n), body twist per length [m/m; rad/m]. False
  /// if no shape balances the load. Does not allocate without load if `by_lengths` has its size.
  bool tipByLengths(const Eigen::VectorXd& lengths, lie::SE3& tip,
                    Eigen::MatrixXd& by_lengths) const;
  /// Derivative of the mean twists (6 sections x n) with respect to lengths (n) [m]. Under load by
  /// differences; zero, and false, if no shape balances the load.
  bool twistsByLengths(const Eigen::VectorXd& lengths, Eigen::MatrixXd& out) const;

 private:
  const ArmModel nominal_;
  ArmModel model_;
  Correction correction_;
  bool moves_twists_ = false;  // whether the offset is not 0
  mutable Eigen::VectorXd scaled_;
};

}  // namespace helix_arm::statics
