#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "helix_arm/dynamics/motion_config.hpp"
#include "helix_arm/model/response.hpp"

/// How a simulated rig deviates from its scene: what a scene says of it, without OpenCV.
namespace helix_arm::simulation {

/// Placement errors of camera and tags of the true rig against its scene: standard deviations of
/// normal noise, equal for all axes.
struct MountDeviation {
  double camera_translation = 0.0;  ///< >= 0 [m]
  double camera_rotation = 0.0;     ///< >= 0 [rad]
  double tag_translation = 0.0;     ///< along the arm and across it, >= 0 [m]
  double tag_rotation = 0.0;        ///< >= 0 [rad]
  std::uint32_t seed = 1;

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// Inertia and damping of the true arm. Its weight is the load's; these masses only resist motion.
struct ArmInertia {
  dynamics::MotionConfig motion;  ///< of order 0
  std::optional<double> mass;     ///< of the whole arm [kg]; absent: the masses of the scene's load
  std::optional<double> K_eps;    ///< of its actuators [N]; absent: the load's
};

/// Difference between the true arm and the arm of its scene.
struct ArmDeviation {
  double K_gamma_scale = 1.0;  ///< > 0
  double K_kappa_scale = 1.0;  ///< > 0
  double length_scale = 1.0;   ///< factor on the free lengths, > 0
  double K_eps_scale = 1.0;    ///< > 0; no effect on an arm that nothing loads
  /// (n) further factors on the free length of each actuator, > 0; empty: 1 each.
  Eigen::VectorXd length_scales = {};
  /// How the true actuators follow their pressures; absent: as the scene's. A TrueArm has no memory
  /// and ignores it, a SimulatedRig does not.
  std::optional<model::Response> response = std::nullopt;
  /// (n) factors on the stroke of each actuator (how far it is from its rest length), > 0; empty: 1
  /// each.
  Eigen::VectorXd stroke_scales = {};
  /// (n) factors on K_gamma, K_tau and K_kappa of each actuator, > 0; empty: 1 each.
  Eigen::VectorXd stiffness_scales = {};
  /// Motion of a SimulatedRig, as the response; absent: it follows its rest at once.
  std::optional<ArmInertia> inertia = std::nullopt;
  /// Time by which a SimulatedRig follows its pressures late, >= 0 [s].
  double dead_time = 0.0;

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// Imperfections of a simulated camera.
struct SimulatedCameraConfig {
  double blur = 0.7;          ///< standard deviation of the lens and sensor, >= 0 [px]
  double noise = 2.0;         ///< standard deviation, >= 0 [gray levels]
  double exposure = 1.0;      ///< factor on every gray level before it saturates, > 0
  double border_shift = 0.0;  ///< width by which white bleeds into black at each edge [m]
  int jpeg_quality = 90;      ///< 1 to 100
  /// Number of objects in the background, some with edges like those of tags, >= 0.
  int clutter = 0;
  int occluders = 0;  ///< number of bars that move through the picture in front of the arm, >= 0
  std::uint32_t seed = 1;
};

/// A simulated motion-capture system.
struct SimulatedBodiesConfig {
  double rate = 100.0;  ///< of the poses, > 0 [Hz]
  double lost = 0.0;    ///< share of the poses of each body that are lost, in [0, 1)
  std::uint32_t seed = 1;
};

/// Thickness of the drawn arm.
struct ArmBody {
  std::vector<double> radius;  ///< of each section [m]; if empty, 0.03 m everywhere
};

}  // namespace helix_arm::simulation
