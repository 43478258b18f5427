#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/shape.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "helix_arm/statics/load.hpp"

namespace helix_arm::statics {

/// A place of the arm for a load, at s in [k, k + 1] along section k; the end of the last one is
/// the tip. @throws std::invalid_argument on another s.
PointLoad placeAt(const model::Arm& arm, double s);

/// Wrench by which the muscles miss what a load requires.
struct MissingWrench {
  int section = 0;                                   ///< where it is largest, from 0 at the base
  double s = 0.0;                                    ///< there, in [0, 1] of that section
  Eigen::Vector3d force = Eigen::Vector3d::Zero();   ///< frame of the base curve there [N]
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();  ///< the same [N m]
};

/// Inputs that hold a shape under a load, or come closest.
struct Attainment {
  bool attainable = false;  ///< residual <= tolerance * largest_force
  Eigen::VectorXd input;    ///< (n) inside the limits [Pa]; of tendons, [rad]
  /// (n) limits without which less would be missing.
  std::vector<Limit> limits;
  MissingWrench missing;
  /// Root mean square over s of the missing wrench, of the section where it is largest [N]: as the
  /// force along the arm that would deform it with the same energy. A shear force counts less by
  /// about the root of K_gamma, a moment about as itself over the radius of the bundle.
  double residual = 0.0;
};

/// Whether an arm can hold given shapes under given loads.
///
/// At each s the actuators of a section make the wrench
///     w(s) = (K_eps / l) sum_i k_i Ad_i^-T K_i (Ad_i^-1 g(s) - l_i e1),
/// which is linear in the free lengths l_i, and the load beyond s requires Ad(X(s))^T W(s). The
/// lengths within the limits whose wrenches are nearest, in the energy of what is missing over
/// Gauss points, are a bounded linear least-squares problem for each section. Where the stiffness
/// depends on pressure it is iterated from several starts. Among equal answers the one of least
/// pressure is taken.
///
/// Immutable, so threads may share it.
class AttainSolver {
 public:
  /// Default tolerance: a residual as a fraction of largestForce().
  static constexpr double kUsualTolerance = 1e-2;

  /// @param load  of the arm in every shape, with its K_eps.
  /// @param tolerance  up to which a shape counts as attainable, as a fraction of largestForce().
  /// @throws std::invalid_argument as Load::validate(), or on a tolerance that is not > 0.
  AttainSolver(model::Arm arm, const Load& load, double tolerance = kUsualTolerance);

  /// Largest change of the sum of its actuators' forces that a section can make by its inputs [N].
  double largestForce() const { return largest_force_; }

  /// @param shape  of the arm, with one piece per section or several. Each is a helix, or, with 8
  /// and
  ///     more per section, the mean of a strain that changes along it, as in shapes under load.
  /// @param points  more loads.
  /// @throws std::invalid_argument if the shape has other sections, or as Load::validate().
  Attainment attain(const model::Shape& shape, const std::vector<PointLoad>& points = {}) const;

 private:
  model::Arm arm_;
  Load load_;
  double tolerance_;
  double largest_force_ = 0.0;
};

}  // namespace helix_arm::statics
