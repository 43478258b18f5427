#include "helix_arm/calibration/calibration.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <set>
#include <utility>

#include "calibration_checks.hpp"
#include "calibration_fit.hpp"
#include "calibration_problem.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/calibration/calibration_parameters.hpp"

namespace helix_arm::estimation {
namespace {

// Residuals larger than expected by this factor cause a warning.
constexpr double kNoisy = 3.0;
// With fewer pressures, leaving one out tells nothing about the certainty of the others.
constexpr std::size_t kFewestPressures = 3;

// K_kappa is searched within this factor (as a log) of the scene's, to this precision.
constexpr double kScanWidth = 4.6;
constexpr int kScanSteps = 400;
constexpr double kScanPrecision = 1e-7;

Calibration refused(Calibration so_far, const Verdict& verdict) {
  so_far.status = verdict.status;
  so_far.reason = verdict.reason;
  return so_far;
}

std::vector<Parameter> fittedParameters(const CalibrationFit& fit) {
  const std::vector<ParameterInfo>& infos = fit.problem->parameters();
  const Eigen::VectorXd values = fit.problem->blocks().vector();
  std::set<std::string> held;
  for (const Parameter& one : fit.held) held.insert(one.name);
  std::vector<Parameter> out;
  for (std::size_t i = 0; i < infos.size(); ++i) {
    const ParameterInfo& info = infos[i];
    if (held.count(info.name) > 0 || !info.reported) continue;
    const double value = info.logarithmic ? info.reference * std::exp(values[i]) : values[i];
    Parameter one{info.name, info.unit, info.initial, value, std::nan(""), false};
    if (fit.covariance.size() > 0) {
      one.standard_error = standardErrorOf(info, value, std::sqrt(fit.covariance(i, i)));
      one.identifiable = fit.identified[i];
    }
    out.push_back(std::move(one));
  }
  return out;
}

// Correlation of the first parameters; the others are not fitted.
Eigen::MatrixXd correlationOf(const Eigen::MatrixXd& covariance, int fitted, int all) {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(all, all);
  for (int i = 0; i < fitted; ++i) {
    for (int j = 0; j < fitted; ++j) {
      out(i, j) = covariance(i, j) / std::sqrt(covariance(i, i) * covariance(j, j));
    }
  }
  return out;
}

// Adds the estimates, without the agreement of the captures.
void addFit(const CalibrationFit& fit, Calibration& out) {
  out.parameters = fittedParameters(fit);
  const int fitted = static_cast<int>(out.parameters.size());
  out.parameters.insert(out.parameters.end(), fit.held.begin(), fit.held.end());
  if (fit.covariance.size() > 0) {
    out.correlation =
        correlationOf(fit.covariance, fitted, static_cast<int>(out.parameters.size()));
  }
  CalibrationProblem& problem = *fit.problem;
  if (!problem.stiffnessEntries().empty()) out.stiffness = problem.stiffness();
  out.K_eps = problem.K_eps();
  out.length_scale = problem.lengthScale();
  out.spline = problem.spline();
  if (out.spline && fit.covariance.size() > 0) out.curve_test = testCurve(fit);
  out.X_B0B = problem.base();
  out.layout = problem.layout();
  out.border_shift = problem.blocks().borderShift();
  for (int c = 0; c < problem.captures(); ++c) {
    out.curves.push_back(problem.shape(c));
    out.shapes.push_back(out.curves.back().twists());
  }
}

bool isOutlier(const Comparison& one, double robust_scale) {
  return one.square > robust_scale * robust_scale * one.residuals;
}

// Adds the agreement of the used readings, per capture and in total.
void addResiduals(const CalibrationProblem& problem, const std::vector<Comparison>& comparisons,
                  Calibration& out) {
  const std::vector<ArmCaptures>& arms = problem.arms();
  struct Sum {
    double square = 0;
    int fitting = 0, outliers = 0;
    std::vector<int> tags;

    double rms() const { return fitting > 0 ? std::sqrt(square / fitting) : 0.0; }
  };
  std::vector<Sum> sums(problem.captures());
  Sum total;
  for (const Comparison& one : comparisons) {
    Sum& sum = sums[one.capture];
    if (isOutlier(one, problem.options().robust_scale)) {
      ++sum.outliers;
      if (one.tag >= 0) {
        sum.tags.push_back(arms[problem.armOf(one.capture)].layout.tags[one.tag].id);
      }
      continue;
    }
    for (Sum* each : {&sum, &total}) {
      each->square += one.error * one.error;
      ++each->fitting;
    }
  }
  out.rms = total.rms();
  int index = 0;
  for (std::size_t a = 0; a < arms.size(); ++a) {
    for (const Capture& capture : arms[a].captures) {
      Sum& sum = sums[index++];
      std::sort(sum.tags.begin(), sum.tags.end());
      out.captures.push_back({static_cast<int>(a), capture.number, sum.rms(), std::move(sum.tags),
                              sum.outliers > sum.fitting, std::nullopt});
    }
  }
}

// The jackknife shows what the noise of single readings does not: a model whose error differs
// between pressures.
void raiseErrors(const std::vector<ParameterInfo>& infos, const Eigen::VectorXd& variance,
                 std::vector<Parameter>& parameters) {
  for (Parameter& one : parameters) {
    for (std::size_t i = 0; i < infos.size(); ++i) {
      if (infos[i].name != one.name || !one.identifiable) continue;
      one.standard_error = std::max(one.standard_error,
                                    standardErrorOf(infos[i], one.value, std::sqrt(variance[i])));
      if (infos[i].logarithmic) one.identifiable = isIdentified(infos[i], variance[i]);
    }
  }
}

// Whether the stiffness stays identified if any one pressure is left out.
bool stiffnessHolds(const CalibrationProblem& problem, const Eigen::VectorXd& variance) {
  const std::vector<ParameterInfo>& infos = problem.parameters();
  for (std::size_t i = 0; i < problem.stiffnessEntries().size(); ++i) {
    if (!isIdentified(infos[i], variance[static_cast<Eigen::Index>(i)])) return false;
  }
  return true;
}

void addHeldOut(const CalibrationFit& fit, const Groups& groups, Calibration& out) {
  const CrossValidation& left_out = *fit.left_out;
  if (groups.pressure.size() >= kFewestPressures) {
    raiseErrors(fit.problem->parameters(), left_out.jackknife.variance(), out.parameters);
  }
  if (!left_out.complete) {
    out.warnings.push_back(
        "some fits without one pressure did not converge: held-out errors are those of their last "
        "iteration");
  }
  out.by_pressure = left_out.by_pressure;
  out.by_arm = left_out.by_arm;
  out.held_out_shapes = left_out.shapes;
}

std::vector<std::string> warningsOf(const Groups& groups, const CalibrationFit& fit,
                                    const std::vector<CaptureResidual>& captures,
                                    const Gains& gains) {
  const std::vector<ArmCaptures>& arms = fit.problem->arms();
  std::vector<std::string> warnings;
  const std::size_t pressures = groups.pressure.size();
  if (pressures < kFewestPressures && fit.covariance.size() > 0) {
    warnings.push_back(messageOf("there are captures at only ", pressures,
                                 " pressures: standard errors reflect the noise alone"));
  }
  for (const Parameter& one : fit.held) {
    warnings.push_back(messageOf("the captures do not determine ", one.name, ": it stays at ",
                                 one.initial, one.unit.empty() ? "" : " ", one.unit));
  }
  std::string outliers, idle;
  for (const CaptureResidual& one : captures) {
    if (!one.outlier) continue;
    outliers += (outliers.empty() ? "" : ", ") +
                (arms.size() > 1 ? arms[one.arm].name + " " : std::string()) +
                std::to_string(one.number);
  }
  for (std::size_t g = 0; g < gains.of.size(); ++g) {
    if (gains.of[g] > gains.least) continue;
    idle += (idle.empty() ? "" : "; ") + pressureText(groups.pressure[g]);
  }
  if (!outliers.empty()) {
    warnings.push_back("captures that do not fit the others: " + outliers);
  }
  if (!idle.empty()) {
    warnings.push_back("captures at these pressures add no information: " + idle +
                       "; capture at the suggested pressures instead");
  }
  if (fit.noise_scale > kNoisy) {
    warnings.push_back(messageOf("residuals are ", std::round(10 * fit.noise_scale) / 10,
                                 " times as large as the noise: a parameter that is not fitted is "
                                 "wrong; standard errors are scaled accordingly"));
  }
  return warnings;
}

// Why the readings disagree with a fit that converged.
std::optional<Verdict> unexplained(const std::vector<Comparison>& comparisons,
                                   double robust_scale) {
  const auto outliers =
      std::count_if(comparisons.begin(), comparisons.end(),
                    [&](const Comparison& one) { return isOutlier(one, robust_scale); });
  if (outliers * 2 <= static_cast<std::ptrdiff_t>(comparisons.size())) return std::nullopt;
  return Verdict{
      CalibrationStatus::kUnexplained,
      messageOf(outliers, " of ", comparisons.size(),
                " readings fit no values of the parameters; check the poses of camera and "
                "tags in the scene, and that the captures are of this arm")};
}

std::optional<Verdict> unidentified(const std::vector<Parameter>& parameters) {
  if (std::none_of(parameters.begin(), parameters.end(),
                   [](const Parameter& one) { return one.identifiable; })) {
    return Verdict{
        CalibrationStatus::kNotIdentifiable,
        "the captures determine none of the parameters to fit; capture at pressures that "
        "bend the arm farther, or fit other parameters"};
  }
  return std::nullopt;
}

// Leaves out each pressure, and each arm, in turn, unless the fit explains too little.
std::optional<CrossValidation> leaveOut(const Groups& groups, const CalibrationFit& fit) {
  const std::vector<Comparison> comparisons = fit.problem->compare(fit.noise_scale);
  if (unexplained(comparisons, fit.problem->options().robust_scale)) return std::nullopt;
  CrossValidation left_out = crossValidate(fit, groups, comparisons);
  left_out.holds_up = groups.pressure.size() < kFewestPressures ||
                      stiffnessHolds(*fit.problem, left_out.jackknife.variance());
  return left_out;
}

}  // namespace

bool ArmCaptures::isLoaded() const {
  return (load && !load->empty() && statics::takesLoad(tier.tier)) ||
         std::any_of(captures.begin(), captures.end(),
                     [](const Capture& capture) { return capture.payload.has_value(); });
}

ArmCaptures ArmCaptures::under(const std::optional<statics::PointLoad>& payload) const {
  // The arm's tier was chosen for its own load.
  constexpr statics::TierSetting kAccurate{statics::Tier::kLoaded, 5};
  ArmCaptures out{name, arm, planar, layout, X_CB, camera, {}, load, tier, free_curve};
  if (!payload) return out;
  out.load.value().points.push_back(*payload);
  if (tier.tier != statics::Tier::kExact) out.tier = kAccurate;
  return out;
}

const char* nameOf(CalibrationStatus status) {
  static constexpr std::array<const char*, 8> kNames = {
      "calibrated",     "no_captures",      "one_pressure", "bad_data",
      "nothing_to_fit", "not_identifiable", "unexplained",  "not_converged"};
  return kNames[static_cast<std::size_t>(status)];
}

Calibration calibrate(const std::vector<ArmCaptures>& arms, const CalibrationOptions& options) {
  Calibration out;
  if (const auto verdict = unsound(arms)) return refused(std::move(out), *verdict);
  out.error_unit = unitOf(kindOf(arms));
  if (const auto verdict = unfit(arms, options)) return refused(std::move(out), *verdict);

  const Groups groups = groupByPressure(arms);
  // Free shapes predict nothing, so no pressure would be more informative than another.
  const bool predicts = !options.free_shapes && options.errors;
  const bool leave_out = predicts && options.held_out;
  const auto check = [&](const CalibrationFit& one) {
    return leave_out ? leaveOut(groups, one) : std::nullopt;
  };
  const CalibrationFit fit = fitIdentified(arms, options, check);
  if (!fit.converged) {
    return refused(std::move(out),
                   {CalibrationStatus::kNotConverged,
                    "the fit did not converge; check the poses of camera and tags in the scene, "
                    "and that the captures are of this arm"});
  }
  addFit(fit, out);
  const std::vector<Comparison> comparisons = fit.problem->compare(fit.noise_scale);
  out.noise_scale = fit.noise_scale;
  if (options.errors) out.usual_scale = usualScale(*fit.problem);
  addResiduals(*fit.problem, comparisons, out);
  if (const auto verdict = unexplained(comparisons, options.robust_scale)) {
    return refused(std::move(out), *verdict);
  }
  const auto nothing = options.errors ? unidentified(out.parameters) : std::nullopt;
  if (nothing) return refused(std::move(out), *nothing);
  std::vector<Jackknife> jackknives;
  if (fit.left_out) {
    if (groups.pressure.size() >= kFewestPressures) {
      const CalibrationFit::Asked& asked = fit.asked;
      if (asked.left_out && fit.problem != asked.problem) jackknives = {*asked.left_out};
      jackknives.push_back(fit.left_out->jackknife);
    }
    addHeldOut(fit, groups, out);
    if (const auto verdict = unidentified(out.parameters)) return refused(std::move(out), *verdict);
  }
  Gains gains;
  if (predicts) {
    gains = gainsOf(fit, groups);
    for (std::size_t c = 0; c < out.captures.size(); ++c) {
      out.captures[c].gain = gains.of[groups.of[c]];
    }
    out.next_pressures = nextPressures(fit);
  }
  out.combinations = combinationsOf(fit, out.parameters, jackknives);
  const std::vector<std::string> warnings = warningsOf(groups, fit, out.captures, gains);
  out.warnings.insert(out.warnings.end(), warnings.begin(), warnings.end());
  if (options.errors) {
    const std::vector<std::string> more = warningsOfHeld(options, fit, out.parameters);
    out.warnings.insert(out.warnings.end(), more.begin(), more.end());
  }
  out.status = CalibrationStatus::kCalibrated;
  return out;
}

std::optional<LeastTipError> fitLeastTipError(const std::vector<ArmCaptures>& arms) {
  if (unsound(arms)) return std::nullopt;
  CalibrationOptions options;
  options.fit = {FitParameter::kKappa};
  if (unfit(arms, options)) return std::nullopt;
  CalibrationProblem problem(arms, options);
  const auto errorAt = [&problem](double log_kappa) {
    problem.setNumbers(Eigen::VectorXd::Constant(1, log_kappa));
    double sum = 0;
    const std::vector<Comparison> comparisons = problem.compare(1.0);
    for (const Comparison& one : comparisons) sum += one.error;
    return sum / static_cast<double>(comparisons.size());
  };
  // A mean of distances may have several minima: scan, then golden-section search around the best.
  double best = 0, least = errorAt(0);
  for (int step = -kScanSteps; step <= kScanSteps; ++step) {
    const double at = kScanWidth * step / kScanSteps, error = errorAt(at);
    if (error < least) {
      least = error;
      best = at;
    }
  }
  if (std::abs(best) == kScanWidth) return std::nullopt;
  const double golden = 0.5 * (std::sqrt(5.0) - 1), width = kScanWidth / kScanSteps;
  double lower = best - width, upper = best + width;
  while (upper - lower > kScanPrecision) {
    const double a = upper - golden * (upper - lower), b = lower + golden * (upper - lower);
    if (errorAt(a) < errorAt(b)) {
      upper = b;
    } else {
      lower = a;
    }
  }
  const double log_kappa = 0.5 * (lower + upper), error = errorAt(log_kappa);
  return LeastTipError{problem.stiffness().kappa, error};
}

}  // namespace helix_arm::estimation
