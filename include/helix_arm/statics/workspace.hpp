#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "helix_arm/statics/arm_model.hpp"

namespace helix_arm::statics {

/// How far the tip moves [m] for an error of 1 kPa in every pressure, of 1 mm in every free length
/// and of 1 % in every entry of the stiffness: names of the three, in the order of their columns.
inline constexpr int kSensitivities = 3;
inline constexpr const char* kSensitivityNames[kSensitivities] = {"per_kpa_m", "per_mm_m",
                                                                  "per_percent_K_m"};

/// Sampled inputs with the tips that they lead to; a row a point.
struct WorkspacePoints {
  Eigen::MatrixXd inputs;        ///< (points x n) [Pa or rad]
  Eigen::MatrixX3d tips;         ///< (points x 3) base frame [m]
  Eigen::MatrixX3d sensitivity;  ///< (points x kSensitivities) [m]; no rows where not asked for
  /// Inputs that are left out: the load finds no balance there or, with sensitivity, so near.
  int unbalanced = 0;

  int count() const { return static_cast<int>(tips.rows()); }
};

struct WorkspaceOptions {
  std::uint64_t seed = 1;
  bool sensitivity = false;
};

/// Where the tip of an arm can go: tips at inputs drawn evenly within the limits.
///
/// Point i of a seed is the same whatever is sampled before it or beside it. Immutable, so that
/// threads may share it.
///
/// Sensitivity: the errors of the actuators are independent, so that their motions add up as root
/// of the sum of squares. By pressure and by length with the tier's own derivatives. By stiffness
/// the motion itself when one of K_gamma, K_tau, K_kappa and, under load, K_eps is 1 % more, of
/// every actuator at once.
class Workspace {
 public:
  /// @throws std::invalid_argument where sensitivity is asked for and some input is no pressure.
  explicit Workspace(const ArmModel& model, const WorkspaceOptions& options = {});

  const ArmModel& model() const { return model_; }
  /// Points that are worth one turn of a thread, yet take a small part of a second: as the tier is
  /// fast.
  int pieceSize() const;

  /// Points first .. first + count - 1 of the seed; count >= 0.
  WorkspacePoints sample(std::uint64_t first, int count) const;

 private:
  Eigen::MatrixXd drawInputs(std::uint64_t first, int count) const;
  void sampleBatch(std::uint64_t first, int count, WorkspacePoints& out) const;
  Eigen::RowVector3d sensitivityAt(const Eigen::VectorXd& q, const Eigen::Vector3d& tip) const;

  ArmModel model_;
  WorkspaceOptions options_;
  bool batch_;                     // nothing loads the arm, as its tier sees it
  std::vector<ArmModel> stiffer_;  // one entry of K 1 % more each
};

}  // namespace helix_arm::statics
