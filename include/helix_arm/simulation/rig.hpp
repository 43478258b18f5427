#pragma once

#include <Eigen/Core>
#include <optional>

#include <opencv2/core.hpp>

#include "helix_arm/estimation/tag_sight.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"
#include "helix_arm/simulation/camera.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/vision/tag_family.hpp"

namespace helix_arm::simulation {

/// How the true arm differs from the arm of its scene, as real ones do.
struct ArmDeviation {
  double K_gamma_scale = 1.0;  ///< > 0
  double K_kappa_scale = 1.0;  ///< > 0
  double length_scale = 1.0;   ///< of the free lengths, > 0
  double K_eps_scale = 1.0;    ///< > 0; of no effect where nothing loads the arm

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// An arm that is not quite what its scene says, under the load of its scene. Whatever tier the
/// scene asks for, its shape is that of the exact one where something loads it.
class TrueArm {
 public:
  /// @throws std::invalid_argument naming the value and its rule.
  TrueArm(const statics::ArmModel& model, const ArmDeviation& deviation);

  const model::Arm& arm() const { return model_.arm(); }
  const statics::ArmModel& model() const { return model_; }
  /// Shape at gauge pressures (n) [Pa], clamped to the limits.
  /// @throws std::invalid_argument on a wrong size, std::out_of_range on a pressure that is no
  /// number, std::runtime_error naming pressures and load where no shape that balances the load is
  /// found: there is then no truth to simulate.
  model::Shape shape(const model::InputRef& pressure) const;
  /// Its mean twists (6 x sections). Throws as shape() does.
  model::Twists twists(const model::InputRef& pressure) const { return shape(pressure).twists(); }

 private:
  statics::ArmModel model_;
  double length_scale_;
};

/// What the camera of a simulated rig is made of.
struct CameraSetup {
  estimation::ArmView view;
  vision::TagFamily family;
  ArmBody body;
  SimulatedCameraConfig config;
};

/// The whole rig: regulators that follow their set points, an arm that follows their pressures at
/// once, and a camera that looks at it. It has no clock; its time is the sum of the steps.
///
/// The same seeds and calls give the same measurements and pictures.
class SimulatedRig {
 public:
  /// @param model  of the scene's arm; the true one deviates from it.
  /// @throws std::invalid_argument naming the value and its rule.
  SimulatedRig(const statics::ArmModel& model, const regulator::SimulatedRegulatorConfig& regulator,
               const ArmDeviation& deviation,
               const std::optional<CameraSetup>& camera = std::nullopt);

  const TrueArm& trueArm() const { return arm_; }
  bool hasCamera() const { return camera_.has_value(); }

  /// Sets the pressures to follow from now on: (n) gauge, finite [Pa]. Throws as
  /// SimulatedRegulator::command() does.
  void command(const model::InputRef& set_point) { regulator_.command(set_point); }
  /// Lets dt >= 0 pass [s]. Throws as SimulatedRegulator::step() does.
  void step(double dt) { regulator_.step(dt); }

  /// True pressures (n), gauge [Pa].
  const Eigen::VectorXd& pressure() const { return regulator_.pressure(); }
  /// One noisy reading of them (n), gauge, may be below 0 [Pa]; each call draws anew.
  Eigen::VectorXd measure() { return regulator_.measure(); }
  /// The shape that the arm has now. Throws as TrueArm::shape() does where no shape is found.
  model::Shape shape() const { return arm_.shape(pressure()); }
  /// Its mean twists (6 x sections). Throws as shape() does.
  model::Twists twists() const { return shape().twists(); }
  /// The next picture (CV_8UC1) of the arm as it is now; valid until the next call.
  /// @throws std::logic_error when the rig has no camera, else as shape() does.
  const cv::Mat& render();

 private:
  TrueArm arm_;
  regulator::SimulatedRegulator regulator_;
  std::optional<SimulatedCamera> camera_;
};

}  // namespace helix_arm::simulation
