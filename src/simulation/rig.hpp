#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <utility>

#include <opencv2/core.hpp>

#include "camera.hpp"
#include "helix_arm/dynamics/motion.hpp"
#include "helix_arm/localization/arm_view.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/vision/tag_detector.hpp"
#include "plant.hpp"

namespace helix_arm::simulation {

/// The true placements of the tags: each is moved by its own noise, as estimation::movedBy() does,
/// except the tag nearest to the base, which defines the base's position.
///
/// The same seed gives the same rig: the noise of a tag depends on its index and scales with the
/// deviations.
/// @throws std::invalid_argument naming the value and its rule.
estimation::TagLayout deviate(const estimation::TagLayout& layout, const model::Arm& arm,
                              const MountDeviation& deviation);

/// The same tags seen by the camera at its true pose: X_CB exp(xi) is the base seen from it, where
/// xi = [v; w] is noise with the camera's deviations.
/// @throws std::invalid_argument naming the value and its rule.
estimation::ArmView deviate(const estimation::ArmView& view, const model::Arm& arm,
                            const MountDeviation& deviation);

/// An arm that deviates from its scene, under the scene's load and a force at its tip. If it is
/// loaded, its shape is computed by the exact tier, whatever tier the scene asks for.
class TrueArm {
 public:
  /// @throws std::invalid_argument naming the value and its rule.
  TrueArm(const statics::ArmModel& model, const ArmDeviation& deviation);

  const model::Arm& arm() const { return model_.arm(); }
  /// The model under the scene's load and the force at the tip.
  const statics::ArmModel& model() const { return pulled_ ? *pulled_ : model_; }

  /// Sets a dead force at the end of the base curve, base frame [N], which adds to the scene's load
  /// and stays until the next one. At first, and with zero, there is none.
  /// @throws std::invalid_argument if it is not finite, or if it is not zero and the model has no
  /// load that tells K_eps; the force in effect then stays.
  void setTipForce(const Eigen::Vector3d& force);

  /// Shape at gauge pressures (n) [Pa], clamped to the limits.
  /// @throws std::invalid_argument on a wrong size, std::out_of_range on a pressure that is NaN,
  /// std::runtime_error naming pressures and load if no shape balances the load: there is then no
  /// truth to simulate.
  model::Shape shape(const model::InputRef& pressure) const;
  /// Its mean twists (6 x sections). Throws as shape() does.
  model::Twists twists(const model::InputRef& pressure) const { return shape(pressure).twists(); }

 private:
  std::optional<statics::Load> load_;        // the scene's, with the true K_eps
  statics::ArmModel model_;                  // without the force at the tip
  std::optional<statics::ArmModel> pulled_;  // with it, unless it is zero
  Eigen::Vector3d tip_force_ = Eigen::Vector3d::Zero();
  Eigen::VectorXd length_scale_;  // (n)
  Eigen::VectorXd stroke_scale_;  // (n)
};

/// Motion of a true arm about the shape at rest that balances its pressures and load,
///
///   M(q) q'' + c(q, q') + D q' + K (q - q_0) = 0,
///
/// with its mean twists q, as dynamics::MovingArmOf has them, and those q_0 at rest.
class Swing {
 public:
  /// @param load  of the arm; null without. @throws as dynamics::MovingArmOf does.
  Swing(const model::Arm& arm, const std::optional<statics::Load>& load, const ArmInertia& inertia);
  Swing(const Swing&) = delete;
  Swing& operator=(const Swing&) = delete;
  /// Advances by dt >= 0 [s] while the shape at rest goes evenly to this one; the first one is
  /// where it starts, and where an infinite time ends.
  /// @throws std::runtime_error if a step finds no solution.
  void step(const model::Shape& rest, double dt);
  /// Lets the next shape be where it starts.
  void restart() { shape_ = {}; }
  /// After the first step.
  const model::Shape& shape() const { return shape_; }

 private:
  dynamics::MovingArmOf<lie::SE3> arm_;
  dynamics::MotionOf<lie::SE3> motion_;
  model::Twists rest_;
  model::Shape shape_;
};

/// A true arm in motion: it follows its pressures with a dead time and a response, and swings about
/// the shape that balances them and the load. It has no clock.
class MovingArm {
 public:
  /// @param model  of the scene's arm. Throws as TrueArm().
  MovingArm(const statics::ArmModel& model, const ArmDeviation& deviation);

  /// As TrueArm::setTipForce(), and throws as it does.
  void setTipForce(const Eigen::Vector3d& force) { arm_.setTipForce(force); }
  /// Follows pressures (n) [Pa] that hold for dt >= 0 [s]; infinity is a rest. Throws as shape().
  void step(const model::InputRef& pressure, double dt);
  /// Follows finite pressures (n) [Pa] read at a time [s], which hold since the last ones. A time
  /// that goes back starts anew. Throws as shape().
  void follow(double time, const model::InputRef& pressure);
  /// The current shape, after the first step. Throws as TrueArm::shape() does.
  model::Shape shape() const;

 private:
  const Eigen::VectorXd& arrived(const model::InputRef& pressure, double dt);

  TrueArm arm_;
  model::ArmResponse response_;
  double dead_time_;
  double time_ = 0.0;                                          // the sum of the steps [s]
  std::deque<std::pair<double, Eigen::VectorXd>> on_the_way_;  // pressures that the arm has not yet
  std::unique_ptr<Swing> swing_;                               // null without inertia
  std::optional<double> last_reading_;                         // its time [s]
};

/// Configuration of the camera of a simulated rig, or of what sees the bodies of its view.
struct CameraSetup {
  estimation::ArmView view;
  vision::TagFamily family;
  ArmBody body;
  SimulatedCameraConfig config;
  SimulatedBodiesConfig bodies = {};
};

/// A complete rig: regulators that follow their set points, an arm that follows their pressures
/// with its response, and a camera. It has no clock; its time is the sum of the steps.
///
/// The same seeds and calls give the same measurements and pictures.
class SimulatedRig {
 public:
  /// @param model   model of the scene's arm, from which the true arm deviates.
  /// @param camera  one of bodies gives no pictures.
  /// @throws std::invalid_argument naming the value and its rule.
  SimulatedRig(const statics::ArmModel& model, const regulator::SimulatedRegulatorConfig& regulator,
               const ArmDeviation& deviation,
               const std::optional<CameraSetup>& camera = std::nullopt);

  /// From now on the true arm is this plant: it gets the regulators' true pressures and the force
  /// at the tip, and tells the shape.
  void takeArm(std::unique_ptr<Plant> plant) { plant_ = std::move(plant); }

  bool hasCamera() const { return camera_.has_value(); }

  /// Sets the set points: (n) gauge, finite [Pa]. Throws as SimulatedRegulator::command() does.
  void command(const model::InputRef& set_point) { regulator_.command(set_point); }
  /// Sets a dead force at the true tip; as TrueArm::setTipForce(), and throws as it does.
  void setTipForce(const Eigen::Vector3d& force);
  /// Advances time by dt >= 0 [s]; a lag of the arm sees the pressures at the end of the step.
  /// Throws as SimulatedRegulator::step() and Plant::step() do.
  void step(double dt);

  /// True pressures (n), gauge [Pa].
  const Eigen::VectorXd& pressure() const { return regulator_.pressure(); }
  /// One noisy reading of them (n), gauge, may be below 0 [Pa]; each call draws anew.
  Eigen::VectorXd measure() { return regulator_.measure(); }
  /// The current shape, at the effective pressures. Throws as TrueArm::shape() does if no
  /// shape is found.
  model::Shape shape() const;
  /// Its mean twists (6 x sections). Throws as shape() does.
  model::Twists twists() const { return shape().twists(); }
  /// The next picture (CV_8UC1) of the arm's current shape; valid until the next call.
  /// @throws std::logic_error if the rig has no camera; otherwise as shape() does.
  const cv::Mat& render();

 private:
  MovingArm arm_;
  regulator::SimulatedRegulator regulator_;
  std::unique_ptr<Plant> plant_;  // null: arm_
  Eigen::Vector3d plant_force_ = Eigen::Vector3d::Zero();
  std::optional<SimulatedCamera> camera_;
};

}  // namespace helix_arm::simulation
