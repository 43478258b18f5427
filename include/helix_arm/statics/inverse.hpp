#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/arm_model.hpp"

namespace helix_arm::statics {

/// Which of the many inputs that reach a target is wanted, where the arm has actuators to spare.
/// Each minimises sum_i ((q_i - q_ref,i) / range_i)^2 with its own q_ref, moving from the inputs
/// first found along those that reach the target: the best nearby, so that a target that moves
/// little never makes the command jump.
enum class Preference {
  kMinPressure,    ///< q_ref = the lower limits: least pressure
  kMinChange,      ///< q_ref = the start given to the solver
  kCocontraction,  ///< q_ref = lower + cocontraction * (upper - lower): a wanted stiffness of the
                   ///< bundle
};

/// The largest entry of a target, [m] or [rad].
inline constexpr double kFarthestTarget = 1e6;

struct InverseOptions {
  Preference preference = Preference::kMinPressure;
  double cocontraction = 0.5;        ///< wanted fraction of each actuator's range, in [0, 1]
  double position_tolerance = 1e-6;  ///< residual at which a target counts as reached [m]
  double rotation_weight = 0.1;  ///< an angle error of 1 rad weighs as much as this distance [m]
  int max_iterations = 200;      ///< of one start
  int max_starts = 24;  ///< tried before a target is called unreachable; under load 6 at most
};

/// Where an actuator stands.
enum class Limit { kNone, kLower, kUpper };

enum class InverseStatus {
  kReached,       ///< residual <= position_tolerance
  kUnreachable,   ///< a local minimum of the residual, the least of all starts: the closest found
  kNotConverged,  ///< the best start had not come to rest within max_iterations, or its valley had
                  ///< not ended: the target may be reachable, the residual says how near it came
};

struct InverseResult {
  Eigen::VectorXd input;  ///< (n) inside the limits: [Pa], or [rad] for tendons
  /// Norm of the weighted error [m]; infinite, and not converged, where no shape holds the load at
  /// any of the starts.
  double residual = 0.0;
  double position_error = 0.0;  ///< distance of the tips [m]; likewise
  std::vector<Limit> limits;    ///< (n) which limits are active
  InverseStatus status = InverseStatus::kNotConverged;
  int iterations = 0;  ///< summed over the starts
  bool converged() const { return status != InverseStatus::kNotConverged; }
};

/// Bounded inverse of the model: a target of the tip or of the twists to inputs within
/// limits.
///
/// Works in the actuators' lengths, where the arm without load is linear up to exp and the limits
/// stay a box; least squares by Levenberg-Marquardt with an active set, from the start given and,
/// if that fails, from sampled ones and corners of the limits. A near miss, such as of an arm that
/// curls to its own base, is followed along its valley. Finds every tip of sampled inputs of the
/// tested arms, whose sections turn up to one and a half times; of arms that curl up further it may
/// miss some. All memory is taken in the constructor: solving does not allocate where nothing loads
/// the arm.
class InverseSolver {
 public:
  /// Keeps a reference to the arm, which must outlive the solver.
  /// @throws std::invalid_argument naming the option that breaks its rule.
  explicit InverseSolver(const model::Arm& arm, const InverseOptions& options = {});
  explicit InverseSolver(const model::Arm&& arm, const InverseOptions& options = {}) = delete;
  /// The same by the model's tier: under load the tip, or the mean twists, of the loaded arm reach
  /// the target. Solving then takes some memory.
  explicit InverseSolver(const ArmModel& model, const InverseOptions& options = {});
  explicit InverseSolver(const ArmModel&& model, const InverseOptions& options = {}) = delete;
  ~InverseSolver();
  InverseSolver(InverseSolver&&) noexcept;
  InverseSolver& operator=(InverseSolver&&) noexcept;

  /// Inputs that bring the tip to a position (base frame) [m].
  ///
  /// @param start  (n) inputs to begin from, inside the limits; the last command makes a warm
  /// start.
  /// @return a result that stays valid until the next call.
  /// @throws std::invalid_argument on a target that is not finite or beyond kFarthestTarget, a
  /// rotation
  ///         that is none, or a start of wrong size or outside the limits.
  const InverseResult& toPosition(const Eigen::Vector3d& position, const model::InputRef& start);
  /// The same for the tip's pose (base frame): least squares of position and rotation_weight *
  /// angle.
  const InverseResult& toPose(const lie::SE3& pose, const model::InputRef& start);
  /// The same for the twists of all sections (6 x sections).
  const InverseResult& toTwists(const model::Twists& twists, const model::InputRef& start);

 private:
  class Workspace;
  std::unique_ptr<Workspace> workspace_;
};

}  // namespace helix_arm::statics
