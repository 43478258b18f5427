#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "helix_arm/statics/arm_model.hpp"

namespace helix_arm::statics {

/// Tip displacement [m] for an error of 1 kPa in every pressure, of 1 mm in every free length and
/// of 1 % in every entry of the stiffness: the names of these three, in the order of the columns.
inline constexpr int kSensitivities = 3;
inline constexpr const char* kSensitivityNames[kSensitivities] = {"per_kpa_m", "per_mm_m",
                                                                  "per_percent_K_m"};

/// Sampled inputs and the resulting tips, one point per row.
struct WorkspacePoints {
  Eigen::MatrixXd inputs;        ///< (points x n) [Pa or rad]
  Eigen::MatrixX3d tips;         ///< (points x 3) base frame [m]
  Eigen::MatrixX3d sensitivity;  ///< (points x kSensitivities) [m]; no rows unless requested
  /// Number of inputs omitted because the load has no equilibrium there or, with sensitivity, at a
  /// neighbouring input.
  int unbalanced = 0;

  int count() const { return static_cast<int>(tips.rows()); }
};

struct WorkspaceOptions {
  std::uint64_t seed = 1;
  bool sensitivity = false;
};

/// Reachable tips of an arm: tips at inputs drawn uniformly within the limits.
///
/// Point i of a seed does not depend on which other points are sampled. Immutable, so threads may
/// share it.
///
/// Sensitivity: the errors of the actuators are assumed independent, so their displacements add as
/// the root of the sum of squares. The pressure and length columns use the tier's own derivatives.
/// The stiffness column is the root of the sum of squares of the displacements when one of K_gamma,
/// K_tau, K_kappa and, under load, K_eps is 1 % larger for every actuator at once.
class Workspace {
 public:
  /// @throws std::invalid_argument if sensitivity is requested and some input is not a pressure.
  explicit Workspace(const ArmModel& model, const WorkspaceOptions& options = {});

  const ArmModel& model() const { return model_; }
  /// Number of points for one unit of work of a thread: worth the overhead, yet a small fraction of
  /// a second at the speed of the tier.
  int pieceSize() const;

  /// Points first .. first + count - 1 of the seed; count >= 0.
  WorkspacePoints sample(std::uint64_t first, int count) const;

 private:
  Eigen::MatrixXd drawInputs(std::uint64_t first, int count) const;
  void sampleBatch(std::uint64_t first, int count, WorkspacePoints& out) const;
  Eigen::RowVector3d sensitivityAt(const Eigen::VectorXd& q, const Eigen::Vector3d& tip) const;

  ArmModel model_;
  WorkspaceOptions options_;
  bool batch_;                     // the tier solves the arm without load
  std::vector<ArmModel> stiffer_;  // each with one entry of K 1 % larger
};

}  // namespace helix_arm::statics
