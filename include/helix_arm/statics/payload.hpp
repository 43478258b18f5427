#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/inverse.hpp"

namespace helix_arm::statics {

/// The rule for a held place, and other loads on the tip.
struct PayloadOptions {
  /// Distance from the place up to which the tip counts as there, as a fraction of the arm's rest
  /// length, > 0.
  double position_tolerance = 0.01;
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();  ///< on the tip, base frame [N m]
};

/// The end of the growth of the force.
enum class PayloadEnd {
  kLimits,      ///< actuators at their limits
  kUnstable,    ///< no stable shape balances a larger force
  kUnactuated,  ///< the tip leaves the place though no limit is met: no actuator acts against it
  kUnreached,   ///< the tip does not get there even without the force
  kNone,        ///< none was found below 10 times the stiffness K_eps of all actuators
};
/// "limits", "unstable", "unactuated", "unreached" or "none".
const char* nameOf(PayloadEnd end);

/// The largest force that the tip carries in one direction.
struct Payload {
  PayloadEnd end = PayloadEnd::kUnreached;
  double force = 0.0;         ///< [N], within 0.1 %; 0 if the place is not reached
  Eigen::VectorXd input;      ///< (n) that hold it [Pa]; of tendons, [rad]
  std::vector<Limit> limits;  ///< (n) limits that end it
  /// Force per motion of the tip along it, at these inputs [N/m]; NaN if the place is not reached,
  /// or at the edge of buckling.
  double stiffness = 0.0;
};

/// The 26 directions from the middle of a cube to its corners, edges and faces, as unit vectors
/// (3 x 26).
Eigen::Matrix<double, 3, 26> payloadDirections();

/// Largest force that an arm holds with its tip at a place: found by bisection over the inverse
/// under load (loaded tier, order 5, or the exact tier if the model has that), each from where the
/// last two answers lead. For an arm with more actuators than its tip needs, or with stiffness that
/// depends on pressure, other starts are tried as well; nothing proves that none carries more.
///
/// The load of the model acts, too. One thread.
class PayloadSolver {
 public:
  /// @throws std::invalid_argument if K_eps of the arm is unknown, or naming the option that breaks
  ///     its rule.
  explicit PayloadSolver(const ArmModel& model, const PayloadOptions& options = {});
  ~PayloadSolver();
  PayloadSolver(PayloadSolver&&) noexcept;
  PayloadSolver& operator=(PayloadSolver&&) noexcept;

  /// Moves to a place of the tip (base frame) [m]. @return the inputs that reach it without the
  /// force, valid until the next call.
  /// @throws as InverseSolver::toPosition().
  const InverseResult& moveTo(const Eigen::Vector3d& tip);
  /// Whether it is within the tolerance there.
  bool isThere() const;

  /// The largest force in a direction, which needs no unit length, base frame. After moveTo().
  /// @throws std::invalid_argument on a direction that is not finite or is 0.
  Payload along(const Eigen::Vector3d& direction);

  /// [m]
  double positionTolerance() const;
  const ArmModel& model() const;

 private:
  class Search;
  std::unique_ptr<Search> search_;
};

}  // namespace helix_arm::statics
