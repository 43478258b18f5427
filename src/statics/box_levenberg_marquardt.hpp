#pragma once

#include <Eigen/Core>

#include "box_quadratic.hpp"
#include "inverse_task.hpp"
#include "length_box.hpp"

namespace helix_arm::statics {

/// A point of the inverse's search, with everything that is known there.
struct InversePoint {
  /// Takes all memory that a task needs. @param rows  the most rows of its residual.
  InversePoint(int actuators, int rows)
      : lengths(actuators), residual(rows), jacobian(rows, actuators) {}

  Eigen::VectorXd lengths;   ///< (n) [m]
  Eigen::VectorXd residual;  ///< (rows) [m]
  Eigen::MatrixXd jacobian;  ///< (rows x n)
  double cost = 0.0;         ///< squared norm of the residual [m^2]
};

/// How a descent ended.
enum class Descent {
  kReached,    ///< at the goal
  kAtRest,     ///< at a local minimum
  kExhausted,  ///< after its last iteration
};

/// Least squares of an inverse task over the lengths inside their box, by Levenberg-Marquardt with
/// an active set.
///
/// Keeps references to task and box; the task's target may change between calls. All memory is
/// taken in the constructor.
class BoxLevenbergMarquardt {
 public:
  /// @param tolerance  residual at which a target counts as reached [m].
  BoxLevenbergMarquardt(const InverseTask& task, const LengthBox& box, double tolerance);

  /// Residual, Jacobian and cost at the point's lengths.
  void evaluate(InversePoint& point) const noexcept;

  /// Moves an evaluated point to the goal or to a local minimum.
  Descent descend(InversePoint& point, int most_iterations) noexcept;

  /// Iterations of all descents since the last restart.
  int iterations() const { return iterations_; }
  void restart() { iterations_ = 0; }

  /// Linearises the task at an evaluated point: normal equations, and the bounds of a step.
  void linearise(const InversePoint& point) noexcept;

  /// Of the linearised point, the damped step; returns the decrease of the cost that the linear
  /// model of the residual promises [m^2].
  /// @param damping  relative to the mean of diag(J'J).
  double proposeStep(const InversePoint& point, double damping) noexcept;
  /// Lengths (n) [m] after the step proposed last, valid until the next call.
  const Eigen::VectorXd& proposed() const { return trial_.lengths; }

  /// Of the linearised point, the step (n) [m] inside the box that minimises the linear model plus
  /// 1/2 x' diag(`diagonal`) x + `gradient`' x; valid until the next call. Once per linearisation.
  const Eigen::VectorXd& stepWith(const Eigen::VectorXd& diagonal,
                                  const Eigen::VectorXd& gradient) noexcept;
  /// Mean of diag(J'J) of the linearised point.
  double scale() const { return scale_; }

 private:
  void buildNormalEquations(const InversePoint& point) noexcept;
  template <int kRows>
  void sumNormalEquations(const InversePoint& point) noexcept;
  bool takeNewtonStep(InversePoint& point) noexcept;

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

/// The least damping: a step of the linear model as it is.
inline constexpr double kLeastDamping = 1e-12;

/// Shortest part of a step that a search along it tries.
inline constexpr double kLeastStepFraction = 0.01;

}  // namespace helix_arm::statics
