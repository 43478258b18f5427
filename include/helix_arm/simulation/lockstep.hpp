#pragma once

#include <Eigen/Core>
#include <deque>
#include <optional>

#include "helix_arm/control/safety.hpp"
#include "helix_arm/follow/visual_servo.hpp"
#include "helix_arm/simulation/rig.hpp"
#include "helix_arm/simulation/simulated_vision.hpp"

namespace helix_arm::simulation {

/// Times of a Lockstep.
struct LockstepConfig {
  double step = 0.01;                ///< of one turn, > 0 [s]
  double picture_period = 1.0 / 30;  ///< > 0 [s]
  double latency = 0.06;             ///< from a picture to its measurement, >= 0 [s]
  /// Pictures within this time are lost [s].
  std::optional<model::Range> blind;

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// A rig, its safety core and a visual servo in one thread and in a fixed order, with a simulated
/// time: the same seeds give the same figures on any machine under any load.
class Lockstep {
 public:
  /// Everything in it; the arm starts enabled, vented and at rest.
  struct Parts {
    statics::ArmModel model;  ///< of the scene, for the tags' search
    SimulatedRig rig;
    SimulatedVision vision;
    control::SafetyCore core;
    follow::VisualServo loop;
  };

  /// @throws std::invalid_argument naming the value and its rule; std::runtime_error if the safety
  /// core refuses to be enabled.
  Lockstep(Parts parts, const LockstepConfig& config);

  /// One step of time: the regulator follows the last orders, is read, the loop turns, its command
  /// goes through the safety core, and pictures whose time has come arrive.
  /// Throws as SimulatedRig::shape() does.
  void advance();

  double time() const { return static_cast<double>(steps_) * config_.step; }  ///< [s]
  SimulatedRig& rig() { return parts_.rig; }
  SimulatedVision& vision() { return parts_.vision; }
  follow::VisualServo& loop() { return parts_.loop; }
  const control::SafetyCore& core() const { return parts_.core; }
  /// Tip of the true arm now, base frame.
  lie::SE3 trueTip() const;
  /// Last measured tip, with the time of its picture; nothing before the first.
  struct MeasuredTip {
    double stamp;
    lie::SE3 tip;
  };
  const std::optional<MeasuredTip>& measuredTip() const { return measured_; }
  int picturesAccepted() const { return accepted_; }

 private:
  struct Waiting {
    double stamp, due;
    MeasuredShape shape;
  };
  void takePicture();
  void deliver();

  Parts parts_;
  const LockstepConfig config_;
  std::int64_t steps_ = 0;
  std::int64_t pictures_ = 0;
  std::deque<Waiting> waiting_;
  Eigen::VectorXd reading_;
  std::optional<MeasuredTip> measured_;
  int accepted_ = 0;
};

}  // namespace helix_arm::simulation
