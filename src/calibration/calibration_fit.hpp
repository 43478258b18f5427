#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "calibration_checks.hpp"
#include "calibration_problem.hpp"

/// Fit of those parameters that the captures determine, with its statistics: noise from residuals,
/// information from readings and priors, prediction of captures that were held out, combinations of
/// stiffness parameters.
namespace helix_arm::estimation {

/// Information of readings and priors about the parameters except those of shapes, marginalised
/// over the shapes.
struct Statistics {
  Eigen::MatrixXd information, covariance;  ///< (parameters x parameters)
};
Statistics statisticsOf(CalibrationProblem& problem, double noise_scale);

/// Joint estimate of parameters and noise.
struct NoisySolution {
  bool converged = false;
  double noise_scale = 1;   ///< noise as a multiple of the expected noise
  double solved_scale = 1;  ///< the scale used in the last solution, close to noise_scale
  double cost = 0;          ///< of the last solution
  double freedom = 1;       ///< of the noise: residuals in excess of the fitted parameters
};
/// Estimates both together, starting from the problem's values, which are updated.
///
/// @param bias  error that the residuals do not show, in expected standard deviations; >= 0.
/// @param rough  ends once the noise is known: values are then off by less than it leaves open.
NoisySolution solveWithNoise(CalibrationProblem& problem, double bias, bool rough = false);

/// Converts a standard deviation from units of the parameter to units of the value.
double standardErrorOf(const ParameterInfo& info, double value, double deviation);

/// Variation of the parameters when one pressure at a time is omitted.
struct Jackknife {
  std::vector<std::string> names;  ///< of the parameters
  /// (pressures x parameters) in the parameters' units: the sum of squares of a column is the
  /// variance of its parameter.
  Eigen::MatrixXd deviations;

  Eigen::VectorXd variance() const { return deviations.colwise().squaredNorm().transpose(); }
};

struct CrossValidation {
  HeldOut by_pressure;
  std::optional<HeldOut> by_arm;      ///< if there are several arms
  std::vector<model::Twists> shapes;  ///< (captures) from the fit without their pressure
  bool complete = true;               ///< whether all fits without a pressure converged
  Jackknife jackknife;                ///< over pressures
  /// Whether the stiffness stays identified if any one pressure is left out.
  bool holds_up = true;
};

struct CalibrationFit : NoisySolution {
  std::shared_ptr<CalibrationProblem> problem;  ///< at the fitted values
  // The sizes are those of the problem's parameters; empty without errors.
  Eigen::MatrixXd information;  ///< from readings and priors
  Eigen::MatrixXd covariance;  ///< includes the prior uncertainty of parameters that are not fitted
  std::vector<bool> identified;
  /// Requested parameters that keep their initial value. They remain parameters of the problem if
  /// no others would be left.
  std::vector<Parameter> held;
  std::optional<CrossValidation> left_out;  ///< by the HeldOutCheck
  /// Fit of all requested parameters, from which `held` was decided.
  struct Asked {
    std::shared_ptr<CalibrationProblem> problem;  ///< null if it did not converge
    double noise_scale = 1;
    std::optional<Jackknife> left_out;
  } asked;
};

/// Leaves out what a fit should predict; nothing if nothing is left out.
using HeldOutCheck = std::function<std::optional<CrossValidation>(const CalibrationFit&)>;

/// Whether a parameter with this variance counts as identified; see Parameter::identifiable.
bool isIdentified(const ParameterInfo& info, double variance);

/// Fits as many entries of the stiffness as the captures identify. Among sets of equal size, the
/// best-determined entries are fitted. The others keep their values. Without errors, fits all.
///
/// The fit keeps a reference to the arms.
/// @param check  that a fit with identified stiffness must pass as well.
CalibrationFit fitIdentified(const std::vector<ArmCaptures>& arms,
                             const CalibrationOptions& options, const HeldOutCheck& check);

/// Second moment of the errors of all requested stiffness logs about the fitted values, held ones
/// included: the posterior at the optimum of all requested parameters, the distance between the
/// two, and the bending of valleys. Other parameters are marginalised.
///
/// @param fit  with `asked`.
/// @return (entries of the requested stiffness)^2.
Eigen::MatrixXd stiffnessErrors(const CalibrationFit& fit);

/// The noise that a sound arm has, from how its squared residuals grow with errors of tags and
/// pressures: see Calibration::usual_scale.
double usualScale(CalibrationProblem& fitted);

/// Test of the curve of a fit that has one and errors.
CurveTest testCurve(const CalibrationFit& fit);

/// Warnings of parameters that the fit took as exact although the captures contradict them, or
/// although the stiffness hangs on them; see Parameter::standard_error.
///
/// Score tests of every parameter that could be fitted as well, about the fitted values, with all
/// others marginalised. One parameter is named, the least probable. Of sound captures, fewer than 1
/// in 100 get such a warning.
/// @param asked  with all that was requested.
std::vector<std::string> warningsOfHeld(const CalibrationOptions& asked, const CalibrationFit& fit,
                                        const std::vector<Parameter>& reported);

// Information of captures about the parameters, and the most informative next pressures. The
// parameters are stiffness and length scales or, if none are fitted, all of them.

/// Information that the captures at each pressure add to that of the others.
struct Gains {
  std::vector<double> of;  ///< (groups) [nats]
  double least = 0;        ///< captures with at most this gain add nothing new [nats]
};
/// Requires a fit with shapes of the model.
Gains gainsOf(const CalibrationFit& fit, const Groups& groups);

/// Pressures within the first arm's limits, best first, each given the previous ones (greedy
/// D-optimal design): at most as many as the options ask for, (actuators) [Pa]. Requires a fit with
/// shapes of the model.
std::vector<Eigen::VectorXd> nextPressures(const CalibrationFit& fit);

/// Repeats the fit without each pressure, and without each arm, in turn.
///
/// @param fit  uses shapes of the model; the values of its problem are restored.
/// @param in_sample  residuals of all readings at its solution.
CrossValidation crossValidate(const CalibrationFit& fit, const Groups& groups,
                              const std::vector<Comparison>& in_sample);

// Combinations of stiffness parameters in which the errors of a calibration are uncorrelated.

/// @param reported  values of the parameters, with the names of `fit`.
/// @param left_out  fits without each pressure, of `fit.asked` and of `fit.problem`; empty if there
///     are too few pressures.
std::vector<Combination> combinationsOf(const CalibrationFit& fit,
                                        const std::vector<Parameter>& reported,
                                        const std::vector<Jackknife>& left_out);

}  // namespace helix_arm::estimation
