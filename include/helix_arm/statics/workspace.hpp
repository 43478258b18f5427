#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <functional>
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

/// How many inputs are drawn, and how.
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
  Eigen::RowVector3d sensitivityAt(const Eigen::VectorXd& q, const Eigen::Vector3d& tip) const;

  ArmModel model_;
  WorkspaceOptions options_;
  bool batch_;                     // the tier solves the arm without load
  std::vector<ArmModel> stiffer_;  // each with one entry of K 1 % larger
};

/// The farthest tips: along and against each axis of the base frame, and away from the base.
class WorkspaceExtremes {
 public:
  /// -x, -y, -z, +x, +y, +z, and the distance from the base.
  static constexpr int kCount = 7;

  /// Inputs (n) [Pa or rad] of an extreme, and its tip, base frame [m].
  struct Extreme {
    Eigen::VectorXd input;
    Eigen::Vector3d tip;
  };

  /// Adds a tip and the inputs that produce it.
  void add(const Eigen::Vector3d& tip, const model::InputRef& input);
  /// Adds all of these points; of equal extremes the first is kept.
  void add(const WorkspacePoints& points);

  bool empty() const { return empty_; }
  /// @param which  index in [0, kCount). Requires !empty().
  const Extreme& of(int which) const { return found_[which]; }
  /// Bounding box of the tips; empty if there are none.
  Eigen::AlignedBox3d bounds() const;
  /// Largest distance of a tip from the base [m]; 0 if there are none.
  double reach() const;

  /// Resolution of sampled extremes: largest distance by which these are beyond them [m].
  double beyond(const WorkspaceExtremes& sampled) const;

  /// Quantity of a tip that extreme `which` maximises [m].
  static double extent(int which, const Eigen::Vector3d& tip);

 private:
  std::array<Extreme, kCount> found_;
  bool empty_ = true;
};

/// Extremes of an arm within the limits of its inputs: a search starts at the farthest of sampled
/// tips and of corners of the limits, and moves one input at a time. Each extreme is a tip that the
/// model reaches at its inputs; nothing proves that there is none beyond it. The search uses all
/// corners or, if they are many, a selection that includes the lowest and the highest inputs: up to
/// 1024 without load, 128 under load, 8 with the exact tier.
///
/// @param sampled  extremes of sampled points of the same model; may be empty.
/// @param stop     once it returns true, the search ends with what it has found.
WorkspaceExtremes findExtremes(const ArmModel& model, WorkspaceExtremes sampled,
                               const std::function<bool()>& stop = {});

}  // namespace helix_arm::statics
