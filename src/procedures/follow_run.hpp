#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/calibration/suspects.hpp"
#include "helix_arm/control/tip_path.hpp"
#include "helix_arm/follow/path_check.hpp"
#include "helix_arm/follow/visual_servo.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/tracking/error_budget.hpp"
#include "loop_config.hpp"
#include "simulation/rig.hpp"
#include "simulation/simulated_vision.hpp"

namespace helix_arm::procedures {

/// A force on the tip of the true arm from a time on.
struct TimedForce {
  double time = 0.0;                                ///< [s]
  Eigen::Vector3d force = Eigen::Vector3d::Zero();  ///< base frame [N]
};

/// A camera that turns slowly: its pictures move at a constant rate, then stay displaced.
struct PictureDrift {
  double begin = 0.0;                                ///< [s]
  double seconds = 10.0;                             ///< > 0 [s]
  Eigen::Vector2d pixels = Eigen::Vector2d::Zero();  ///< displacement at the end [px]
};

/// Task of a simulated arm, and its conditions. Either tips or a path.
struct FollowPlan {
  std::vector<Eigen::Vector3d> tips;     ///< base frame [m]; they share the seconds evenly
  std::optional<control::TipPath> path;  ///< begins when the tip has moved to its first point
  double seconds = 10.0;                 ///< > 0 [s]
  bool to_path_end = false;              ///< ends with the path, after `seconds` at the latest
  bool open = false;                     ///< the loop stays open
  bool ignore_contacts = false;          ///< see follow::VisualServo::ignoreContacts()
  /// Command of a simulation::Plant that stands in for the rig's true arm; empty: none does.
  std::string plant;
  simulation::VisionKind vision = simulation::VisionKind::kCorners;
  std::optional<TimedForce> force;
  std::optional<model::Range> blind;  ///< pictures of these times are lost [s]
  std::optional<PictureDrift> drift;
  std::optional<model::Range> frozen;  ///< the camera hangs: see SimulatedVision::freeze() [s]
  double latency = 0.06;               ///< of the pictures' measurements, >= 0 [s]
  std::uint32_t seed = 1;              ///< of the noise of readings, corners and pictures
};

/// One turn of the run. Tips are positions, base frame [m].
struct FollowRow {
  double time;  ///< [s]
  std::optional<Eigen::Vector3d> wanted;
  Eigen::Vector3d true_tip;
  /// New in this turn, with the time of its picture [s].
  std::optional<Eigen::Vector3d> measured;
  double measured_time;
  std::optional<Eigen::Vector3d> predicted;
  /// Covariance of `predicted`, without the placements, in rows with `measured`: see
  /// follow::Prediction [m^2].
  std::optional<Eigen::Matrix3d> predicted_covariance;
  Eigen::VectorXd pressure;  ///< (n) true, gauge [Pa]
  follow::LoopState state;
  std::optional<double> path_time;  ///< since the path's start [s]
  /// `wanted` is out of reach of the corrected arm, which goes to the closest place.
  bool unreachable = false;
  std::vector<statics::Limit> limits;  ///< (n) at which the commanded pressures are; empty without
  double load_score = 0.0;             ///< of a force on the arm, see estimation::ExternalLoad
};

/// Least time of a tip: its last second is its steady state [s].
inline constexpr double kLeastTipTime = 1.0;

/// Errors of the true tip against the wanted one.
struct FollowFigures {
  /// From the path's start to its end, or to that of the run [m]; nothing if it did not start.
  std::optional<double> path_rms, path_max;
  /// Error of the last turn of a closed path, from where it last passed its end before; its whole
  /// if it has one turn [m].
  std::optional<double> last_turn_rms;
  std::vector<double> steady_rms;             ///< of each tip's last second [m]
  std::vector<std::optional<double>> settle;  ///< time until within 2 mm + 5 % for good [s]
  std::vector<bool> unreachable;              ///< tips that are out of the arm's reach at their end
  std::vector<std::vector<statics::Limit>> limits;  ///< of each tip at its end, see FollowRow
};

/// A change of the loop's state.
struct FollowState {
  double time;  ///< [s]
  follow::LoopState state;
};

/// A contact that the loop found. Force and covariance are of the last picture of the contact.
struct FollowAlarm {
  double time;                 ///< when it was found [s]
  double onset;                ///< when it began, by estimate [s]
  Eigen::Vector3d force;       ///< base frame [N], or per K_eps if normalised
  Eigen::Matrix3d covariance;  ///< of the force
  bool normalised;             ///< the scene has no K_eps
};

/// A run along tips or a path, and its figures.
struct FollowResult {
  std::vector<FollowRow> rows;
  FollowFigures figures;  ///< nothing if the run ended early
  /// Why the run ended early: the safety core's reason to vent the arm; empty if it did not.
  std::string vented;
  std::vector<FollowState> states;
  std::vector<FollowAlarm> alarms;  ///< except those that the suspects explain
  /// The camera or the arm's base, once the pictures showed that it is not where the scene says.
  struct Move {
    double time;  ///< [s]
    estimation::BaseMove base;
  };
  std::optional<Move> moved;
  /// Usual mistakes of the rig that explain why the arm does not move as the scene says, best
  /// first, as last found.
  std::vector<estimation::Suspect> suspects;
  double contact_blind = 0.0;    ///< time in which contacts may not be found [s]
  estimation::QuietScore quiet;  ///< of all of it, if contacts were ignored
  int pictures = 0;              ///< accepted
  std::string why_unseen;        ///< why the last picture was not, if none was
  /// Ids of fitted tags that no capture of the scene's calibration shows, ascending.
  std::vector<int> uncalibrated_tags;
  /// By which the arm follows its pressures late, errors of stamps included, and half the width of
  /// its hysteresis, as estimated; 0 if the scene tells them [s], [Pa].
  estimation::Estimated lag, play;
  /// At the last accepted picture; nothing without one.
  std::optional<estimation::TipErrorBudget> budget;
};

/// Lets a plan with a path end with it; its time is then that of the path and of the longest way to
/// its first point.
void endWithPath(FollowPlan& plan);

/// Why a run has no figures, or none of a closed loop, and what to do; empty if it has.
std::string failureOf(const FollowPlan& plan, const FollowResult& result);

/// Whether the scene's model can follow a path within its slew rates: see follow::checkPath().
std::optional<follow::PathRefusal> checkPath(const io::Scene& scene, const control::TipPath& path);

/// The simulated rig of a scene, and its camera.
struct SeenRig {
  simulation::SimulatedRig rig;
  simulation::SimulatedVision vision;
};
/// @param rig    scene of the true arm, regulator, camera and tags; `plant` as in FollowPlan.
/// @param seed   of the noise of readings, corners and pictures.
/// @throws std::invalid_argument naming what the scenes lack, or in what their arms differ.
SeenRig seenRigOf(const io::Scene& scene, const io::Scene& rig, const std::string& plant,
                  simulation::VisionKind kind, std::uint32_t seed);

/// Simulates the scene's rig with its visual servo. The same plan and scene give the same result.
/// @param plan  a path should have passed checkPath().
/// @throws std::invalid_argument naming what the scene lacks or the plan breaks; std::runtime_error
///     if no shape of the true arm holds its load.
FollowResult runFollow(const io::Scene& scene, const FollowPlan& plan,
                       const std::function<bool(double)>& progress = {});
/// The same on the rig of another scene: its true arm, regulator, camera and tags, as of hardware
/// that `scene` was calibrated on.
/// @throws also if the arms have other sections or actuators, or the scenes other tags.
FollowResult runFollow(const io::Scene& scene, const io::Scene& rig, const FollowPlan& plan,
                       const std::function<bool(double)>& progress = {});

}  // namespace helix_arm::procedures
