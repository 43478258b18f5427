#pragma once

#include <Eigen/Core>
#include <array>
#include <memory>
#include <string>
#include <vector>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/correction.hpp"

namespace helix_arm::statics {

/// Which inputs to prefer if several reach the target, as with redundant actuators. Each preference
/// except kStiff minimises sum_i ((q_i - q_ref,i) / range_i)^2 with its own q_ref. The search
/// starts at the first solution and moves along the inputs that reach the target, so it finds a
/// local minimum: a small change of the target does not make the command jump. The compliance has
/// several minima, since muscles may be softest inside their range: kStiff also searches from other
/// solutions and takes the stiffest minimum, so its command may jump.
enum class Preference {
  kMinPressure,    ///< q_ref = the lower limits: lowest pressures
  kMinChange,      ///< q_ref = the start given to the solver
  kCocontraction,  ///< q_ref = lower + cocontraction * (upper - lower), to choose the stiffness of
                   ///< the bundle
  kStiff,  ///< least compliance of the tip: the sum over the axes of its motion along a force
           ///< per force. Needs a model whose K_eps is known
};

/// Words of the preferences, in their order.
inline constexpr std::array<const char*, 4> kPreferenceWords{"min-pressure", "min-change",
                                                             "cocontract", "stiff"};
/// The preference of a word. @throws std::invalid_argument naming the word, quoted, and the others.
Preference preferenceOf(const std::string& word);

/// Largest accepted magnitude of a target's entry, [m] or [rad].
inline constexpr double kFarthestTarget = 1e6;

/// Preference and end of an inverse.
struct InverseOptions {
  Preference preference = Preference::kMinPressure;
  double cocontraction = 0.5;        ///< preferred fraction of each actuator's range, in [0, 1]
  double position_tolerance = 1e-6;  ///< residual up to which a target counts as reached [m]
  /// Position error that weighs as much as an angle error of 1 rad [m]
  double rotation_weight = 0.1;
  int max_iterations = 200;  ///< per start
  /// Starts tried before a target counts as unreachable; at most 6 under load.
  int max_starts = 24;
};

/// Active limit of an actuator.
enum class Limit { kNone, kLower, kUpper };

enum class InverseStatus {
  kReached,       ///< residual <= position_tolerance
  kUnreachable,   ///< a local minimum of the residual, the lowest of all starts: the closest
                  ///< solution found
  kNotConverged,  ///< the best start did not settle within max_iterations, or its valley did not
                  ///< end; the target may be reachable, and the residual is the error of the best
                  ///< iterate
};

/// Inputs that reach a target, or come closest.
struct InverseResult {
  Eigen::VectorXd input;  ///< (n) inside the limits: [Pa], or [rad] for tendons
  /// Norm of the weighted error [m]. Infinite, with status kNotConverged, if no shape balances the
  /// load at any start.
  double residual = 0.0;
  /// Distance from the tip to the target [m]; infinite in the same case.
  double position_error = 0.0;
  std::vector<Limit> limits;  ///< (n) active limit of each actuator
  InverseStatus status = InverseStatus::kNotConverged;
  int iterations = 0;  ///< sum over all starts
  bool converged() const { return status != InverseStatus::kNotConverged; }
};

/// Bounded inverse of the model: from a target for the tip or the twists to inputs within limits.
///
/// The search works in the actuators' lengths, where the unloaded arm is linear up to exp and the
/// limits remain a box. It is a least-squares search by Levenberg-Marquardt with an active set. It
/// begins at the given start and, if that fails, continues with sampled inputs and corners of the
/// limits. A near miss, as with an arm that curls to its own base, is followed along its valley.
/// The solver finds every tip of sampled inputs of the tested arms, whose sections turn up to one
/// and a half times; for arms that curl further it may miss some. All memory is allocated in the
/// constructor: solving does not allocate if the arm has no load.
class InverseSolver {
 public:
  /// With the tier of the model: under load, the tip or the mean twists of the loaded arm reach the
  /// target, and solving allocates some memory. An arm alone is a model without load.
  /// @throws std::invalid_argument naming the option that breaks its rule.
  explicit InverseSolver(const ArmModel& model, const InverseOptions& options = {});
  ~InverseSolver();
  InverseSolver(InverseSolver&&) noexcept;
  InverseSolver& operator=(InverseSolver&&) noexcept;

  /// From now on the tip or the twists of the corrected arm reach the target. The limits stay those
  /// of the inputs. Does not allocate if only the offset or the length scales change, without load.
  /// @throws as CorrectedModel::set().
  void correct(const Correction& correction);

  /// From now on inputs are searched between lower and upper (n), which are within the limits of
  /// the arm: for actuators with a response, their attainable effective pressures
  /// (model::ArmResponse::effectiveLimits()). Does not allocate.
  /// @throws std::invalid_argument naming the actuator and the rule.
  void limit(const model::InputRef& lower, const model::InputRef& upper);

  /// Inputs that bring the tip to a position (base frame) [m].
  ///
  /// @param start  (n) initial inputs, inside the limits; pass the last command for a warm start.
  /// @return the result, valid until the next call.
  /// @throws std::invalid_argument on a target that is not finite or beyond kFarthestTarget, an
  ///     invalid rotation matrix, or a start of wrong size or outside the limits.
  const InverseResult& toPosition(const Eigen::Vector3d& position, const model::InputRef& start);
  /// The same for the tip's pose (base frame): least squares of the position error and
  /// rotation_weight * angle error.
  const InverseResult& toPose(const lie::SE3& pose, const model::InputRef& start);
  /// The same for the twists of all sections (6 x sections).
  const InverseResult& toTwists(const model::Twists& twists, const model::InputRef& start);

 private:
  class Workspace;
  std::unique_ptr<Workspace> workspace_;
};

}  // namespace helix_arm::statics
