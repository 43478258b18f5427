#pragma once

#include <Eigen/Core>
#include <optional>
#include <set>
#include <string>
#include <variant>
#include <vector>

#include "helix_arm/calibration/contraction_fit.hpp"
#include "helix_arm/localization/camera.hpp"
#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/localization/twist_fit.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/shape.hpp"
#include "helix_arm/statics/load.hpp"
#include "helix_arm/statics/tier.hpp"

namespace helix_arm::estimation {

/// Length-scaled curvature |(w_y, w_z)| of an arm with one section.
struct CurvatureReading {
  double curvature;  ///< >= 0 [rad]
};

/// Twists from another fit; under load, the mean twists of the sections.
struct TwistReading {
  model::Twists twists;        ///< (6 x sections), v [m], w [rad]
  Eigen::MatrixXd covariance;  ///< (6 sections x 6 sections), positive definite
};

/// Measurements while the pressures were constant. All readings of a data set have the same kind.
using Reading = std::variant<CurvatureReading, TwistReading, std::vector<PoseObservation>,
                             std::vector<CornerObservation>>;

/// Measurements at one set of inputs.
struct Capture {
  int number;                ///< number in its data set
  Eigen::VectorXd pressure;  ///< (actuators) gauge, within the limits [Pa]
  Reading reading;
  std::optional<double> time = std::nullopt;  ///< on the clock of a series of the arm [s]
  std::optional<statics::PointLoad> payload = std::nullopt;  ///< on the arm, beside its own load
};

/// A contraction curve that is fitted together with the arm.
struct FreeCurve {
  ContractionSpline spline;     ///< as the free lengths determine it
  std::vector<bool> actuators;  ///< whether each actuator follows it
};

/// One arm as described by its scene, and its measurements.
struct ArmCaptures {
  std::string name;  ///< name in messages
  model::Arm arm;
  bool planar = false;  ///< the arm bends only in its x-y plane
  TagLayout layout;     ///< for readings of tags
  lie::SE3 X_CB;        ///< nominal base seen from the camera, for readings of corners
  Camera camera;        ///< that camera
  std::vector<Capture> captures;
  /// The load, and the tier that computes the shapes: a tier chosen for the scene, the same for all
  /// parameter values. A tier without loads ignores the load.
  std::optional<statics::Load> load = std::nullopt;
  statics::TierSetting tier = {};
  /// The same spline for all arms that have one; required of the first if contraction is fitted.
  std::optional<FreeCurve> free_curve = std::nullopt;

  /// Whether the tier accounts for a load on the arm, or more hangs on it in any capture.
  bool isLoaded() const;
  /// The arm without captures, under its own load and what hangs on it; requires a load.
  ArmCaptures under(const std::optional<statics::PointLoad>& payload) const;
};

/// Quantities that can be fitted, in the order of fitParameters(), which is that of messages and
/// help.
enum class FitParameter {
  kKappa,
  kGamma,
  kTau,
  kEps,
  kLengthScale,
  kLengthScaleEach,
  kStrokeScaleEach,
  kContraction,
  kResponse,
  kMode,
  kMass,
  kDamping,
  kRingRadius,
  kRingPhase,
  kBase,
  kTags,
  kBorderShift,
};
constexpr int kFitParameterCount = static_cast<int>(FitParameter::kBorderShift) + 1;  ///< how many

/// Blocks of the least-squares problem, which contain the numbers of the parameters.
enum class ParameterBlock {
  kStiffness,    ///< logs of all fitted entries of the stiffness
  kLengthScale,  ///< logs of all length scales
  kStrokeScale,  ///< logs of the stroke scales of all actuators
  kBase,
  kBorderShift,
  kTag,    ///< placement of one tag
  kCurve,  ///< numbers of a FreeCurve, of unit variance by its free lengths; not of a request
  kShape,  ///< twists of one capture; not a parameter of a request
};
constexpr int kParameterBlockCount = static_cast<int>(ParameterBlock::kShape) + 1;  ///< how many

/// Which parameters are fitted, and the prior knowledge of them.
struct CalibrationOptions {
  /// Those with a block (fitParameters()), and kContraction: the FreeCurve of the arms, under what
  /// the free lengths say. K_eps is one for all sections and requires a load; kStrokeScaleEach has
  /// one factor per actuator on how far its free length is from that at the lower end of its curve;
  /// kTags are the placements of all tags except the one nearest to the base, which defines the
  /// reference frame; kBorderShift is the width of white bleeding into black and requires corners.
  std::set<FitParameter> fit = {FitParameter::kKappa, FitParameter::kGamma};
  /// Fit the twists of every capture instead of using the model's shapes, for placements that do
  /// not depend on the model. Cannot be combined with stiffness and scales, which free shapes do
  /// not determine.
  bool free_shapes = false;

  // Expected standard deviations; the residuals correct them.
  double curvature_noise = 0.02;  ///< [rad]
  double corner_noise = 0.3;      ///< of a corner's coordinate [px]
  /// Lower bound of the corner noise, whatever the residuals indicate: the placements absorb part
  /// of the errors from blur, bleeding and perspective. >= 0 [px]
  double corner_floor = 0.2;
  double position_noise = 0.010;  ///< of a tag's position, per axis [m]
  double rotation_noise = 0.0;    ///< of a tag's rotation [rad]; 0 ignores rotations
  double robust_scale = 3.5;      ///< as in TwistFitOptions, for tags and curvatures
  /// Standard deviation of the logs about the scene's values: a factor of three.
  double stiffness_prior = 1.1;
  double length_scale_prior = 0.05;  ///< standard deviation of the scales about 1
  double stroke_scale_prior = 0.05;  ///< likewise
  BasePrior base_prior{0.1, 0.5};
  TagPrior tag_prior;
  double border_shift_prior = 0.0005;  ///< [m]
  ModelPrior model_prior;              ///< prior of free shapes

  /// Standard errors and everything that follows from them: verdicts, correlations, combinations,
  /// gains, held-out fits and suggestions. Without, the fit takes the least time, and every
  /// requested parameter has its value at the optimum. These are the values with errors, unless a
  /// verdict holds a parameter that the captures do not determine.
  bool errors = true;
  bool held_out = true;      ///< refit without each pressure, and without each arm, in turn
  int next_pressures = 3;    ///< number of pressures to suggest
  int max_iterations = 100;  ///< per least squares

  bool fits(FitParameter parameter) const { return fit.count(parameter) > 0; }
};

/// Whether a calibration has a result.
enum class CalibrationStatus {
  kCalibrated,
  kNoCaptures,       ///< no captures, or none with enough tags
  kOnePressure,      ///< with a single pressure, parameters cannot be told apart
  kBadData,          ///< NaN, wrong sizes, pressures outside the limits
  kNothingToFit,     ///< no parameter was requested, or none that readings of this kind determine
  kNotIdentifiable,  ///< the captures determine none of the requested parameters
  kUnexplained,      ///< more than half of the readings do not fit any parameter values
  kNotConverged,
};
/// "calibrated", "no_captures", ...
const char* nameOf(CalibrationStatus status);

/// Largest relative standard error of an identifiable stiffness or length scale.
constexpr double kLargestRelativeError = 0.5;

/// Usual error of the pressure in a muscle, by its regulator and by friction in the muscle [Pa].
constexpr double kPressureError = 5e3;

/// One calibrated parameter.
struct Parameter {
  std::string name;  ///< K_kappa, length_scale, base_x, tag_7_s, ...
  std::string unit;  ///< m^2, m, rad, or empty
  double initial;    ///< value before the fit
  double value;      ///< fitted value; for a stiffness that is not identifiable, the initial value
  /// The larger of two estimates: the error due to noise, including the prior uncertainty of tags,
  /// bleeding and stiffness ratios that are not fitted; and the variation when one pressure at a
  /// time is omitted. The error due to noise includes the uncertainty of a FreeCurve, fitted or
  /// not. Base, length scales and K_eps count as exact unless fitted; a warning names the one that
  /// the captures contradict. If the parameter is not identifiable, its remaining uncertainty. NaN
  /// without CalibrationOptions::errors.
  double standard_error;
  /// True if the error due to noise is at most half of the prior's standard deviation. For a
  /// stiffness or a length scale, this holds for the whole standard error, which must also be at
  /// most kLargestRelativeError of the value. False without CalibrationOptions::errors.
  bool identifiable;
};

/// Smallest correlation of two stiffness parameters, or size of it, that makes their combinations
/// worth reporting.
constexpr double kLeastCorrelation = 0.5;
/// Smallest exponent, or size of it, that the name of a combination gives beyond the two largest.
constexpr double kLeastExponent = 0.05;

/// Product of powers of stiffness parameters whose error is not correlated with that of the other
/// combinations: an eigenvector of the covariance of their logarithms.
///
/// That covariance is the second moment of the errors of the reported values, by the readings and
/// the priors of all requested stiffness parameters, including those that keep their initial value.
struct Combination {
  /// One factor of the product.
  struct Power {
    std::string parameter;
    double exponent;
  };
  std::string name;           ///< "K_gamma^0.97 K_kappa^0.25"; see kLeastExponent
  std::vector<Power> powers;  ///< at least two: a unit vector, the largest first and > 0
  double value;               ///< of the reported parameters, in their units
  /// Standard deviation of its logarithm: as for a parameter, the larger of the error due to noise
  /// and the variation when one pressure at a time is omitted, but that at most the prior's.
  double relative_error;
  bool identifiable;  ///< by the rule of a stiffness: see Parameter::identifiable
};

/// Agreement of one capture with the calibrated arm.
struct CaptureResidual {
  int arm;                        ///< index of the data set
  int number;                     ///< number of the capture
  double rms;                     ///< over the readings that fit [rad, px or m]
  std::vector<int> outlier_tags;  ///< ids of the tags that do not fit, ascending
  bool outlier;                   ///< whether more than half of the capture does not fit
  /// Information that the captures at its pressure add about stiffness and length scales or, if
  /// none are fitted, about all parameters [nats]. Absent with free shapes and without errors.
  std::optional<double> gain;
};

/// Prediction error of held-out data.
struct HeldOut {
  /// A pressure or an arm that was held out.
  struct Group {
    std::string label;
    double error;
  };
  /// Error over all groups: RMS of curvatures [rad], or the median over tips or tags, so that wrong
  /// detections have no influence: distance [m] or RMS of the corners [px].
  double error;
  double in_sample;  ///< the same error of the fit to all captures
  std::vector<Group> groups;
  std::vector<double> captures;  ///< (captures of all arms) the same error of each
};

/// Joint test of all numbers of a fitted FreeCurve: whether captures and free lengths are of one
/// curve.
struct CurveTest {
  /// Squared deviation of the curve from that of the free lengths alone, by the covariance that it
  /// has if both are of one curve.
  double chi_square;
  int directions;  ///< of the curve that the captures tell: the degrees of freedom
  /// Probability of a chi-square at least as large if both are of one curve. Takes into account
  /// that few captures determine their noise only roughly.
  double probability;
};

/// Parameters of an arm and its rig, with their uncertainties.
struct Calibration {
  CalibrationStatus status = CalibrationStatus::kNoCaptures;
  std::string reason;  ///< cause and remedy; empty if calibrated
  std::vector<Parameter> parameters;
  /// (parameters x parameters); rows of parameters that are not fitted are 0. Empty without errors.
  Eigen::MatrixXd correlation;
  /// Combinations of stiffness parameters, best known first: as many as are correlated by
  /// kLeastCorrelation or more with another; empty if none are, none is identifiable, or the fit of
  /// all did not end.
  std::vector<Combination> combinations;

  std::optional<model::Stiffness> stiffness;  ///< of every actuator
  std::optional<double> K_eps;                ///< of every section, if fitted [N]
  /// (actuators of the first arm) factors on its free lengths; 1 if not fitted.
  Eigen::VectorXd length_scale;
  std::optional<ContractionSpline>
      spline;                           ///< the FreeCurve as fitted; root: by free lengths alone
  std::optional<CurveTest> curve_test;  ///< of the FreeCurve, with errors
  lie::SE3 X_B0B;                       ///< fitted base seen from the nominal base
  TagLayout layout;                     ///< with the fitted placements
  double border_shift = 0;              ///< [m]
  /// (captures of all arms) mean twists, predicted by the fits without their pressure; empty
  /// without held-out fits.
  std::vector<model::Twists> held_out_shapes;
  /// (captures of all arms) mean twists, from the model or fitted.
  std::vector<model::Twists> shapes;
  std::vector<model::Shape> curves;  ///< the same shapes including their bending by the load, for
                                     ///< use as a model in TwistFitter

  std::string error_unit;  ///< unit of rms and held-out errors: rad, px or m
  double rms = 0;          ///< over the readings that fit
  /// How many times as large as expected the noise is, by the residuals; at least 1.
  double noise_scale = 1;
  /// The usual value in a sound arm, whose tags are placed as tag_prior says and whose pressures
  /// are off by kPressureError; 1 without CalibrationOptions::errors.
  double usual_scale = 1;
  std::vector<CaptureResidual> captures;
  std::optional<HeldOut> by_pressure, by_arm;
  /// (actuators) of the first arm [Pa]: the most informative next pressures, best first.
  std::vector<Eigen::VectorXd> next_pressures;
  std::vector<std::string> warnings;
};

/// Maximum-likelihood estimate of stiffness, length scales, base and placements, in one robust
/// least-squares fit of all captures.
///
/// Several arms share stiffness and length scales. Base, tags and border shift can only be fitted
/// for a single arm. Faults of the data are reported in the status.
Calibration calibrate(const std::vector<ArmCaptures>& arms, const CalibrationOptions& options);

/// K_kappa by the paper's definition: minimum mean tip error over captures of twists. Curvatures
/// determine no tip; for them, the minimum mean error of the curvature.
struct LeastTipError {
  double K_kappa;  ///< [m^2]
  double error;    ///< mean error at K_kappa [m or rad]
};
/// Empty if calibrate() would refuse the captures, or if the error has no minimum within a factor
/// of 100 of the scene's K_kappa.
std::optional<LeastTipError> fitLeastTipError(const std::vector<ArmCaptures>& arms);

}  // namespace helix_arm::estimation
