#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <vector>

#include "helix_arm/dynamics/moving_arm.hpp"

namespace helix_arm::dynamics {

/// Where the energy of a motion went [J]: kinetic + elastic + potential + dissipated = work.
struct Energy {
  double kinetic = 0.0, elastic = 0.0;
  double potential = 0.0;  ///< of gravity and dead forces, since the start
  double dissipated = 0.0;
  double work = 0.0;  ///< of actuators and dead moments, with the elastic energy at the start
};

/// Coordinates q (n) of a MovingArmOf and their rates (n).
struct MotionState {
  Eigen::VectorXd position, rate;
};

/// Small motions about a shape at rest, x = q - q_0, with forces f on the coordinates:
/// M x'' + D x' + K x = f.
struct LinearMotion {
  Eigen::VectorXd position;  ///< q_0 (n)
  /// M, D and K (n x n); K is the slope of the elastic forces, of weight and of dead forces.
  Eigen::MatrixXd mass, damping, stiffness;
  Eigen::MatrixXd by_input;  ///< (n x actuators) f by the effective inputs, per Pa
  lie::SE3 tip;              ///< at q_0, seen from the arm's base
  Eigen::Matrix3Xd tip_by;   ///< (3 x n) slope of its position
};

/// The vibrations of small motions, slowest first; a motion that creeps back is none.
std::vector<Vibration> vibrationsOf(const LinearMotion& motion);

/// An arm in motion.
template <class Group>
class MotionOf {
 public:
  /// @param arm  outlives the motion.
  explicit MotionOf(const MovingArmOf<Group>& arm);

  /// Starts at rest: in the equilibrium of the arm's order under load at these unloaded twists (dof
  /// x sections), or straight, with the twists that every actuator gives at its rest length.
  /// @throws std::runtime_error if no equilibrium is found.
  void startAtRest(const model::TwistsOf<Group>& unloaded);
  void startStraight(const model::TwistsOf<Group>& unloaded);
  /// Starts in this state. @throws std::invalid_argument on a wrong size.
  void startAt(const model::TwistsOf<Group>& unloaded, const MotionState& state);

  /// Moves on by a time [s], during which the unloaded twists go from the last ones to these.
  ///
  /// One step of the implicit midpoint rule, of second order, with a force along the momentum that
  /// makes energy balance to rounding. Newton's iteration takes M, K and D as its slope, so that
  /// stiff strains take as many iterations as soft ones. Does not allocate.
  /// @return whether it converged; otherwise the state is as before.
  bool step(double dt, const model::TwistsOf<Group>& unloaded) noexcept;

  const MovingArmOf<Group>& arm() const { return arm_; }
  const Eigen::VectorXd& position() const { return q_; }  ///< (n)
  const Eigen::VectorXd& rate() const { return v_; }      ///< (n)
  Group tip() const { return arm_.tip(q_); }
  /// Small motions about where it is, as if it were at rest there; without `by_input`.
  LinearMotion linearised();
  Energy energy() const;

 private:
  void begin(const model::TwistsOf<Group>& unloaded);
  void settle();
  void findRest();
  Eigen::VectorXd restForce(const Eigen::VectorXd& q);
  Eigen::MatrixXd restSlope(const Eigen::VectorXd& q);
  void residualAt(double dt) noexcept;
  bool solve(double dt) noexcept;
  double elasticEnergy() const noexcept;

  const MovingArmOf<Group>& arm_;
  typename MovingArmOf<Group>::Terms terms_;
  typename MovingArmOf<Group>::Energies now_{}, next_{};
  double dissipated_ = 0.0, work_ = 0.0, potential_at_start_ = 0.0;
  double carry_ = 0.0;      // of the energy's balance, which the next step corrects [J]
  double last_step_ = 0.0;  // [s]; 0: none yet
  // Coordinates, their rates and those without load, at the begin of a step, its middle and end.
  Eigen::VectorXd q_, v_, target_, mid_q_, mid_v_, next_q_, next_v_, next_target_;
  Eigen::VectorXd last_v_, momentum_, change_, elastic_, residual_;
  Eigen::MatrixXd slope_;
  Eigen::LLT<Eigen::MatrixXd> factors_;
};

}  // namespace helix_arm::dynamics
