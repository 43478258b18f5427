#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include "helix_arm/dynamics/motion.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/load.hpp"

namespace helix_arm::dynamics {

/// Where a motion starts at rest: in the equilibrium under load at the first inputs, or straight,
/// at natural length.
enum class Start { kRest, kStraight };
/// At rest, or in any state.
using Beginning = std::variant<Start, MotionState>;

/// Inputs over time, linear between the rows.
struct InputSeries {
  std::vector<double> time;                              ///< (rows) ascending [s]
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic,  ///< (rows x actuators), within limits
                Eigen::RowMajor>
      input;
};

/// Steps of a motion, and where its energy went.
struct MotionSummary {
  long steps = 0;
  Energy energy;
};

/// An arm in motion, step by step, with the responses of its actuators.
class ArmDriver {
 public:
  virtual ~ArmDriver() = default;
  /// Starts at inputs (n) within the limits, to which the actuators have responded.
  /// @throws std::runtime_error if there is no equilibrium to start from; std::invalid_argument on
  ///     a wrong size.
  virtual void start(const Eigen::VectorXd& input, const Beginning& beginning) = 0;
  /// Moves on by dt > 0 [s], while the inputs (n), within the limits, go evenly from one to the
  /// other. @throws std::runtime_error if a step finds no solution.
  virtual void advance(double dt, const Eigen::VectorXd& from, const Eigen::VectorXd& to) = 0;

  virtual MotionState state() const = 0;
  virtual lie::SE3 tip() const = 0;  ///< seen from the arm's base
  virtual const MotionSummary& summary() const = 0;
};

/// An arm that moves by its inputs: its actuators' responses, then the equations of MovingArmOf.
///
/// Arms in a plane whose load keeps them there move in it. Immutable, so threads may share it.
class ArmMotion {
 public:
  /// @param planar  the arm in its plane, if it has one.
  /// @throws std::invalid_argument naming what motion needs: masses, K_eps, and as MovingArmOf
  /// does.
  ArmMotion(const model::Arm& arm, const std::optional<model::PlanarArm>& planar,
            const std::optional<statics::Load>& load, const MotionConfig& config);

  /// Called with each time of `at` in turn, and the tip's pose seen from the arm's base. Returns
  /// whether to go on.
  using Sink = std::function<bool(std::size_t index, const lie::SE3& tip)>;

  /// Moves over a series. Its rows and `at` divide time into spans; each takes as many steps of
  /// equal length as config().step asks for.
  /// @param at  ascending times within the series [s]. Ends early where the sink says so.
  /// @throws std::invalid_argument naming the row whose time or input breaks a rule;
  ///     std::runtime_error if there is no equilibrium to start from, or a step finds no solution.
  MotionSummary follow(const InputSeries& series, const Beginning& beginning,
                       const std::vector<double>& at, const Sink& sink) const;

  /// The arm for steps of its own; this outlives it.
  std::unique_ptr<ArmDriver> driver() const;

  /// Small motions about the equilibrium under load at inputs (n).
  /// @throws std::invalid_argument naming an input that breaks a rule, std::runtime_error if there
  ///     is no equilibrium.
  LinearMotion linearisedAt(const Eigen::VectorXd& input) const;

 private:
  model::Arm arm_;
  std::variant<MovingArmOf<lie::SE3>, MovingArmOf<lie::SE2>> moving_;
};

}  // namespace helix_arm::dynamics
