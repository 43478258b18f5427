#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "helix_arm/estimation/tag_layout.hpp"
#include "helix_arm/estimation/twist_fit.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/shape.hpp"
#include "helix_arm/statics/load.hpp"
#include "helix_arm/statics/tier.hpp"

namespace helix_arm::estimation {

/// Length-scaled curvature |(w_y, w_z)| of an arm of one section.
struct CurvatureReading {
  double curvature;  ///< >= 0 [rad]
};

/// Twists that another fit found, under load the mean ones of the sections.
struct TwistReading {
  model::Twists twists;        ///< (6 x sections), v [m], w [rad]
  Eigen::MatrixXd covariance;  ///< (6 sections)^2, positive definite
};

/// What was measured while the pressures stood still. All readings of a data set are of one kind.
using Reading = std::variant<CurvatureReading, TwistReading, std::vector<PoseObservation>,
                             std::vector<CornerObservation>>;

struct Capture {
  int number;                ///< as its data set counts them
  Eigen::VectorXd pressure;  ///< (actuators) gauge, within the limits [Pa]
  Reading reading;
};

/// One arm as its scene has it, and what was measured of it.
struct ArmCaptures {
  std::string name;  ///< in messages
  model::Arm arm;
  bool planar = false;  ///< it bends in its x-y plane alone
  TagLayout layout;     ///< where readings are of tags
  lie::SE3 X_CB;        ///< nominal base seen from the camera, where readings are corners
  double focal = 0;     ///< of that camera, > 0 [px]
  std::vector<Capture> captures;
  /// What loads it, and the tier that finds its shapes: one of a scene's choice, the same for all
  /// parameters. A tier that knows of no load leaves the load out.
  std::optional<statics::Load> load = std::nullopt;
  statics::TierSetting tier = {};

  /// Whether a load bends its shapes.
  bool isLoaded() const;
};

/// Factors on the free lengths of the actuators: what contraction curves most often have wrong.
enum class LengthScaling {
  kNone,
  kCommon,  ///< one for all
  kEach,    ///< one an actuator
};

/// Standard deviations of where a tag sits about where the scene puts it.
struct TagPrior {
  double translation = 0.002;  ///< along the arm, and across it on either axis [m]
  double rotation = 0.052;     ///< about each axis [rad]
};

/// What is fitted, and what is known of it before.
struct CalibrationOptions {
  bool K_kappa = true;
  bool K_gamma = true;
  bool K_tau = false;
  bool K_eps = false;  ///< one for all sections; only a load tells of it
  LengthScaling length_scale = LengthScaling::kNone;
  bool base = false;   ///< the base as camera or instrument sees it
  bool tags = false;   ///< placement of every tag but the one nearest to the base, which fixes the
                       ///< frame that all is seen from
  bool bleed = false;  ///< that white bleeds into black, of corners
  /// Fit the twists of every capture as well, instead of taking the model's: placements that do not
  /// trust the model. Not together with stiffness and length scales, which shapes then say nothing
  /// of.
  bool free_shapes = false;

  double curvature_noise =
      0.02;                   ///< expected standard deviations; the residuals correct them [rad]
  double corner_noise = 0.3;  ///< [px]
  /// No corner is better than this, whatever the residuals say: part of what blur, bleeding and
  /// perspective do to it is taken up by the placements. >= 0 [px]
  double corner_floor = 0.2;
  double position_noise = 0.010;     ///< of a tag pose, each axis [m]
  double rotation_noise = 0.0;       ///< [rad]; 0 leaves rotations out
  double robust_scale = 3.5;         ///< as TwistFitOptions has it, for tags and curvatures
  double stiffness_prior = 1.1;      ///< of the logs about the scene's: known to a factor of three
  double length_scale_prior = 0.05;  ///< standard deviation of the scales about 1
  BasePrior base_prior{0.1, 0.5};
  TagPrior tag_prior;
  double bleed_prior = 0.0005;  ///< [m]
  ModelPrior model_prior;       ///< of free shapes

  bool held_out = true;      ///< refit without each pressure, and each arm, in turn
  int next_pressures = 3;    ///< how many to suggest
  int max_iterations = 100;  ///< of each least squares

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

enum class CalibrationStatus {
  kCalibrated,
  kNoCaptures,       ///< or none with enough tags
  kOnePressure,      ///< nothing tells parameters apart where the pressure is always the same
  kBadData,          ///< NaN, wrong sizes, pressures outside the limits
  kNothingToFit,     ///< nothing was asked for, or not with readings like these
  kNotIdentifiable,  ///< the captures say nothing of any of the parameters asked for
  kUnexplained,      ///< more than half of the readings do not fit, whatever the parameters
  kNotConverged,
};
/// "calibrated", "no_captures", ...
const char* nameOf(CalibrationStatus status);

/// No stiffness or length scale whose relative standard error is larger is called identifiable.
constexpr double kLargestRelativeError = 0.5;

/// One calibrated number.
struct Parameter {
  std::string name;  ///< K_kappa, length_scale, base_x, tag_7_s, ...
  std::string unit;  ///< m^2, m, rad, or empty
  double initial;    ///< before
  double value;      ///< fitted; of a stiffness that is not identifiable, the initial one
  /// The larger of what the noise gives, with what their priors leave unknown of tags, bleeding and
  /// ratios of stiffness that are not fitted, and of what leaving out one pressure at a time does.
  /// Base, length scales and K_eps that are not fitted count as exact. Where not identifiable, how
  /// little is known.
  double standard_error;
  /// What the noise gives is at most half of the prior's deviation. Of a stiffness or a length
  /// scale the whole standard error is, and at most kLargestRelativeError of the value.
  bool identifiable;
};

/// How one capture agrees with the calibrated arm.
struct CaptureResidual {
  int arm;                        ///< index of its data set
  int number;                     ///< of the capture
  double rms;                     ///< of the readings that fit [rad, px or m]
  std::vector<int> outlier_tags;  ///< ids of those that do not, ascending
  bool outlier;                   ///< more than half of it does not fit
  /// Information that the captures at its pressure add about stiffness and scales, or, where none
  /// are fitted, about all [nats]. Absent where shapes are free.
  std::optional<double> gain;
};

/// How well what was left out is predicted.
struct HeldOut {
  /// A pressure, or an arm, that was left out.
  struct Group {
    std::string label;
    double error;
  };
  /// Over all groups: RMS of curvatures [rad]; median of tips and tags, so that wrong detections do
  /// not decide, in distance [m] or RMS of its corners [px].
  double error;
  double in_sample;  ///< the same of the fit to all captures
  std::vector<Group> groups;
};

/// Parameters of an arm and its rig, and how far to trust them.
struct Calibration {
  CalibrationStatus status = CalibrationStatus::kNoCaptures;
  std::string reason;  ///< culprit and remedy; empty where calibrated
  std::vector<Parameter> parameters;
  Eigen::MatrixXd correlation;  ///< (parameters)^2; rows of parameters that are not fitted are 0

  std::optional<model::Stiffness> stiffness;  ///< of every actuator
  std::optional<double> K_eps;                ///< of every section, where it was fitted [N]
  Eigen::VectorXd length_scale;  ///< (actuators of the first arm) factors on its free lengths; 1
  lie::SE3 X_B0B;                ///< base seen from where it was thought to be
  TagLayout layout;              ///< with the placements found
  double bleed = 0;              ///< [m]
  /// (captures of all arms) as fits without their pressure predict them, mean twists; empty without
  /// held-out fits.
  std::vector<model::Twists> held_out_shapes;
  std::vector<model::Twists> shapes;  ///< (captures of all arms), of the model or fitted, mean
  std::vector<model::Shape> curves;   ///< the same with what the load bends, as a fit needs them

  std::string error_unit;  ///< of rms and held-out errors: rad, px or m
  double rms = 0;          ///< over the readings that fit
  std::vector<CaptureResidual> captures;
  std::optional<HeldOut> by_pressure, by_arm;
  /// (actuators) of the first arm [Pa]: what would say most next, best first.
  std::vector<Eigen::VectorXd> next_pressures;
  std::vector<std::string> warnings;
};

/// Maximum likelihood of stiffness, length scales, base and placements, in one robust least squares
/// over all captures.
///
/// Several arms share stiffness and length scales; base, tags and bleed are fitted for one arm
/// only.
/// @throws std::invalid_argument where the options break their rules; what data can cause is in the
/// status.
Calibration calibrate(const std::vector<ArmCaptures>& arms, const CalibrationOptions& options);

/// K_kappa by the paper's definition: least mean error of the tip, over captures of twists; of
/// curvatures, from which no tip follows, least mean error of the curvature.
struct LeastTipError {
  double K_kappa;  ///< [m^2]
  double error;    ///< mean, with it [m or rad]
};
/// Nothing where calibrate() would refuse the captures, and where the error has no valley within a
/// factor of 100 of the scene's K_kappa.
std::optional<LeastTipError> fitLeastTipError(const std::vector<ArmCaptures>& arms);

}  // namespace helix_arm::estimation
