#pragma once

#include <Eigen/Core>

#include "box_quadratic.hpp"
#include "helix_arm/model/arm.hpp"
#include "inverse_task.hpp"

namespace helix_arm::statics {

/// A point of the inverse's search with its residual and Jacobian.
struct InversePoint {
  /// Allocates all memory that a task needs. @param rows  maximum number of rows of its residual.
  InversePoint(int actuators, int rows)
      : lengths(actuators), residual(rows), jacobian(rows, actuators) {}

  Eigen::VectorXd lengths;   ///< (n) [m]
  Eigen::VectorXd residual;  ///< (rows) [m]
  Eigen::MatrixXd jacobian;  ///< (rows x n)
  double cost = 0.0;         ///< squared norm of the residual [m^2]
};

/// How a descent ended.
enum class Descent {
  kReached,    ///< the residual is within the tolerance
  kAtRest,     ///< at a local minimum
  kExhausted,  ///< the maximum number of iterations was reached
};

/// Least squares of an inverse task over a box of lengths: Levenberg-Marquardt with an active set.
///
/// Keeps references to task and box; the target may change between calls. Allocates only when made.
class BoxLevenbergMarquardt {
 public:
  /// @param tolerance  residual at which a target counts as reached [m].
  BoxLevenbergMarquardt(const InverseTask& task, const LengthBox& box, double tolerance);

  /// Computes residual, Jacobian and cost at the point. Throws as InverseTask::evaluate().
  void evaluate(InversePoint& point) const;

  /// Moves an evaluated point to the goal or to a local minimum.
  Descent descend(InversePoint& point, int most_iterations);

  /// Number of iterations of all descents since the last restart().
  int iterations() const { return iterations_; }
  void restart() { iterations_ = 0; }

  /// Linearises the task at an evaluated point: normal equations and bounds of a step.
  void linearise(const InversePoint& point) noexcept;

  /// Computes the damped step of the linearised point. Returns the decrease of the cost that the
  /// linear model of the residual predicts [m^2].
  /// @param damping  relative to the mean of diag(J'J).
  double proposeStep(const InversePoint& point, double damping) noexcept;
  /// Lengths (n) [m] after the last proposed step, valid until the next call.
  const Eigen::VectorXd& proposed() const { return trial_.lengths; }

  /// The step (n) [m] of the linearised point inside the box that minimises the linear model plus
  /// 1/2 x' diag(`diagonal`) x + `gradient`' x; valid until the next call. One per linearisation.
  const Eigen::VectorXd& stepWith(const Eigen::VectorXd& diagonal,
                                  const Eigen::VectorXd& gradient) noexcept;
  /// Mean of diag(J'J) at the linearised point.
  double scale() const { return scale_; }

 private:
  void buildNormalEquations(const InversePoint& point) noexcept;
  template <int kRows>
  void sumNormalEquations(const InversePoint& point) noexcept;
  bool takeNewtonStep(InversePoint& point);

  const InverseTask& task_;
  const LengthBox& box_;
  double tolerance_;
  int n_;
  int iterations_ = 0;
  InversePoint trial_;
  BoxQuadratic step_;
  Eigen::MatrixXd normal_;  // J'J, lower triangle
  double scale_ = 1.0;      // mean of its diagonal
};

/// Least damping: practically the undamped step of the linear model.
inline constexpr double kLeastDamping = 1e-12;

/// Smallest fraction of a step that a line search tries.
inline constexpr double kLeastStepFraction = 0.01;

}  // namespace helix_arm::statics
