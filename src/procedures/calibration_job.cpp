#include "helix_arm/procedures/calibration_job.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <set>

#include "curve_in_arm.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/estimation/calibration_parameters.hpp"
#include "helix_arm/io/calibrated_scene.hpp"
#include "helix_arm/io/number.hpp"
#include "helix_arm/procedures/calibration_words.hpp"
#include "helix_arm/procedures/capture_scatter.hpp"
#include "helix_arm/procedures/captures.hpp"
#include "least_tip_error.hpp"
#include "response_calibration.hpp"
#include "tip_error.hpp"

namespace helix_arm::procedures {
namespace {

using estimation::ArmCaptures;
using estimation::Calibration;
using estimation::CalibrationOptions;
using estimation::CalibrationStatus;
using estimation::FitParameter;

bool areCorners(const std::vector<estimation::Capture>& captures) {
  return !captures.empty() && std::holds_alternative<std::vector<estimation::CornerObservation>>(
                                  captures.front().reading);
}

// Parameters that the words of a request select for this data.
std::set<FitParameter> fittedOf(const CalibrationRequest& request, const CalibrationData& data) {
  std::set<FitParameter> fitted =
      estimation::fitParametersOf(request.fit, areCorners(data.captures));
  // Captures of an arm determine the error of its curves, but not the curves themselves.
  if (data.lengths.empty() && fitted.erase(FitParameter::kContraction) > 0) {
    fitted.insert(FitParameter::kLengthScale);
  }
  return fitted;
}

bool isOfArm(FitParameter parameter) { return estimation::infoOf(parameter).block.has_value(); }

CalibrationOptions optionsOf(const io::Scene& scene, const CalibrationRequest& request,
                             std::set<FitParameter> fitted, const CalibrationData& data) {
  CalibrationOptions options;
  bool about_shape = false;
  for (const estimation::FitParameterInfo& info : estimation::fitParameters()) {
    about_shape |= info.aboutShape() && fitted.count(info.parameter) > 0;
    if (info.implied && areCorners(data.captures)) fitted.insert(info.parameter);
  }
  estimation::setFitted(fitted, options);
  // Placements that are fitted alone must not depend on the accuracy of the model.
  options.free_shapes = !about_shape;

  const estimation::TwistFitOptions& expected = scene.vision.fit;
  const auto chosen = [](double asked, double usual) { return asked > 0 ? asked : usual; };
  const auto check = [](const char* what, double noise) {
    basics::requireValue(std::isfinite(noise) && noise >= 0, "calibration", what, noise,
                         "a finite value >= 0, 0 for the scene's");
  };
  check("the curvature noise", request.curvature_noise);
  check("the corner noise", request.corner_noise);
  check("the position noise", request.position_noise);
  check("the rotation noise", request.rotation_noise);
  options.curvature_noise = chosen(request.curvature_noise, options.curvature_noise);
  options.corner_noise = chosen(request.corner_noise, expected.corner_noise);
  options.position_noise = chosen(request.position_noise, expected.position_noise);
  options.rotation_noise = chosen(request.rotation_noise, expected.rotation_noise);
  options.robust_scale = expected.robust_scale;
  options.tag_prior = scene.tag_prior;
  options.bleed_prior = expected.bleed_prior;
  return options;
}

// The contraction curve that the free lengths belong to.
std::optional<std::string> curveName(const io::Scene& scene, const std::string& asked,
                                     std::string& message) {
  std::string names;
  for (const auto& [name, response] : scene.contractions) {
    names += (names.empty() ? "" : ", ") + name;
    if (name == asked) return name;
  }
  if (asked.empty() && scene.contractions.size() == 1) return scene.contractions.begin()->first;
  message = asked.empty() ? "scene " + scene.name + " has the contractions " + names +
                                "; name the one that was measured"
                          : "scene " + scene.name + " has no contraction " + asked +
                                "; expected one of " + names;
  return std::nullopt;
}

io::Provenance provenanceOf(const std::string& path, const std::string& sha256,
                            const std::vector<io::Override>& overrides,
                            const CalibrationRequest& request,
                            const std::vector<io::Provenance::Data>& sources,
                            const CalibrationOutcome& outcome) {
  io::Provenance out;
  out.date = request.date;
  out.package_version = HELIX_ARM_VERSION;
  out.from = path;
  out.from_sha256 = sha256;
  for (const io::Override& one : overrides) {
    out.overrides += (out.overrides.empty() ? "" : " ") + one.key + "=" + one.value;
  }
  out.data = sources;
  if (outcome.calibration) {
    const Calibration& calibration = *outcome.calibration;
    out.rms = calibration.rms;
    if (calibration.by_pressure) out.held_out_error = calibration.by_pressure->error;
    out.error_unit = calibration.error_unit;
  } else {
    out.rms = outcome.contractions.empty() ? outcome.response->fit.rms
                                           : outcome.contractions.front().second.rms;
    out.error_unit = "m";
  }
  for (const estimation::Parameter& one : parametersOf(outcome)) {
    if (!isJudged(one)) continue;
    out.parameters.push_back({one.name, one.value, one.standard_error, one.identifiable, one.unit});
  }
  if (!outcome.calibration) return out;
  for (const estimation::Combination& one : outcome.calibration->combinations) {
    io::Provenance::Combination combination{{}, one.relative_error, one.identifiable};
    for (const estimation::Combination::Power& power : one.powers) {
      combination.exponents[power.parameter] = power.exponent;
    }
    out.combinations.push_back(std::move(combination));
  }
  return out;
}

// Captures of a scene, with the poses of tags seen from the base that another scene knows.
std::vector<estimation::Capture> seenFrom(const io::Scene& other, const io::Scene& scene,
                                          std::vector<estimation::Capture> captures) {
  const lie::SE3 X_B1B = other.X_BF * scene.X_BF.inverse();
  for (estimation::Capture& capture : captures) {
    auto* const poses = std::get_if<std::vector<estimation::PoseObservation>>(&capture.reading);
    if (poses == nullptr) continue;
    for (estimation::PoseObservation& one : *poses) one.X_BT = X_B1B * one.X_BT;
  }
  return captures;
}

// Adds the captures of another arm, without those that show no tag of it.
void addArm(const io::Scene& scene, const std::vector<estimation::Capture>& captures,
            CalibrationOutcome& outcome) {
  ArmCaptures arm = makeArmCaptures(scene, {});
  std::vector<int> empty;
  for (const estimation::Capture& capture : captures) {
    const auto* poses = std::get_if<std::vector<estimation::PoseObservation>>(&capture.reading);
    const auto* corners = std::get_if<std::vector<estimation::CornerObservation>>(&capture.reading);
    if ((poses != nullptr && poses->empty()) || (corners != nullptr && corners->empty())) {
      empty.push_back(capture.number);
    } else {
      arm.captures.push_back(capture);
    }
  }
  if (!empty.empty()) {
    outcome.warnings.push_back("captures of " + arm.name +
                               " without a tag of the arm: " + io::listOf(empty));
  }
  const auto same =
      std::count_if(outcome.arms.begin(), outcome.arms.end(),
                    [&scene](const ArmCaptures& one) { return one.name == scene.name; });
  if (same > 0) arm.name += " (" + std::to_string(same + 1) + ")";
  outcome.arms.push_back(std::move(arm));
}

std::string joinedNames(const std::vector<std::string>& names) {
  std::string out;
  for (const std::string& name : names) out += (out.empty() ? "" : ", ") + name;
  return out;
}

CalibrationOutcome refused(CalibrationOutcome outcome, const std::string& message) {
  outcome.success = false;
  outcome.message = message;
  return outcome;
}

}  // namespace

CalibrationOutcome runCalibration(const std::string& path,
                                  const std::vector<io::Override>& overrides,
                                  const CalibrationRequest& request, const CalibrationData& data,
                                  const std::vector<CompanionArm>& companions) {
  const std::set<FitParameter> fitted = fittedOf(request, data);
  CalibrationOutcome outcome;
  outcome.warnings = data.warnings;
  std::vector<io::Provenance::Data> sources = data.sources;
  for (const CompanionArm& one : companions) {
    sources.insert(sources.end(), one.data.sources.begin(), one.data.sources.end());
    outcome.warnings.insert(outcome.warnings.end(), one.data.warnings.begin(),
                            one.data.warnings.end());
    if (!one.data.lengths.empty()) {
      return refused(outcome, "the data of " + one.scene.name +
                                  " holds free lengths; give only those of the scene's own arm");
    }
  }
  if (const auto twice = repeatedSource(sources)) return refused(outcome, *twice);
  io::Scene scene = io::loadScene(path, overrides);
  const std::string sha256 = scene.sha256;
  io::SceneCalibration curves;
  const bool fits_arm = std::any_of(fitted.begin(), fitted.end(), isOfArm);
  const bool fits_curve = fitted.count(FitParameter::kContraction) > 0;
  const bool fits_response = fitted.count(FitParameter::kResponse) > 0;
  if (!fits_curve && !fits_response && !data.lengths.empty()) {
    return refused(outcome,
                   "the data holds free lengths, but no contraction is fitted; leave it out, "
                   "or fit contraction as well");
  }
  // A series also gives the effective pressures of captures whose times are known.
  const bool timed = std::any_of(data.captures.begin(), data.captures.end(),
                                 [](const auto& capture) { return capture.time.has_value(); });
  if (!fits_response && !data.tips.empty() && !timed) {
    return refused(outcome,
                   "the data holds a series of the tip, but no response is fitted; leave it out, "
                   "or fit response as well");
  }
  std::optional<std::string> name;
  if (fits_curve || (fits_response && (data.tips.empty() || !request.contraction.empty()))) {
    std::string message;
    name = curveName(scene, request.contraction, message);
    if (!name) return refused(outcome, message);
  }
  if (fits_response) {
    std::vector<std::string> names;
    for (const auto& [one, response] : scene.contractions) {
      if (!name || one == *name) names.push_back(one);
    }
    if (const auto fault = fitResponseOf(scene, request, data, names, outcome)) {
      return refused(outcome, *fault);
    }
    for (const std::string& one : names) {
      curves.responses.emplace_back(one, outcome.response->response);
    }
  }
  bool remembers = false;  // the muscle whose curve is fitted
  if (fits_curve) {
    const model::Response response =
        outcome.response ? outcome.response->response : scene.contractions.at(*name);
    remembers = !response.instant();
    const bool with_arm = fits_arm && !data.captures.empty();
    const estimation::CurveKind usual =
        with_arm && !remembers ? estimation::CurveKind::kSpline : estimation::CurveKind::kQuintic;
    outcome.lengths = effectiveSamples(data.lengths, response);
    estimation::ContractionFit fit = estimation::fitContraction(
        outcome.lengths, {request.curve.value_or(usual), request.branch});
    if (fit.curve && remembers) {
      fit = continuedTo(data.lengths.history.input.maxCoeff(), std::move(fit));
    }
    outcome.contractions.emplace_back(*name, fit);
    if (fit.status != estimation::ContractionFitStatus::kFitted) {
      return refused(outcome, "contraction " + *name + ": " + fit.reason);
    }
    curves.contractions = outcome.contractions;
  }
  if (!fits_arm && !companions.empty()) {
    return refused(outcome,
                   "other arms share the stiffness, but it is not fitted; fit it, or leave out the "
                   "other arms");
  }
  io::SceneCalibration changes;
  std::vector<estimation::Capture> captures = data.captures;
  if (fits_arm) {
    // From here on, the arm has its new curves.
    const model::Arm before = scene.arm;
    const auto putCurves = [&] {
      curves.contractions = outcome.contractions;
      curves.provenance = provenanceOf(path, sha256, overrides, request, sources, outcome);
      scene = io::sceneOfText(io::calibratedSceneText(path, overrides, curves, sha256), path);
    };
    if (fits_curve || fits_response) putCurves();
    if (timed && !data.tips.empty()) {
      EffectiveCaptures effective = effectiveCaptures(scene.arm, data.tips, data.captures);
      captures = std::move(effective.captures);
      if (!effective.unknown.empty()) {
        outcome.warnings.push_back(
            "captures that the series of the tip does not cover are taken "
            "at their measured pressures: " +
            io::listOf(effective.unknown));
      }
    }
    addArm(scene, captures, outcome);
    for (const CompanionArm& one : companions) addArm(one.scene, one.data.captures, outcome);
    for (const ArmCaptures& arm : outcome.arms) {
      if (arm.captures.empty()) return refused(outcome, "no capture of " + arm.name + " was given");
    }
    CalibrationOptions options = optionsOf(scene, request, fitted, data);
    // The effective pressures of the captures are unknown.
    const bool in_arm = fits_curve && !remembers && !options.free_shapes &&
                        outcome.contractions.front().second.spline.has_value();
    std::vector<std::string> others;
    for (std::size_t a = 1; a < outcome.arms.size(); ++a) others.push_back(outcome.arms[a].name);
    options.errors = request.errors || in_arm;
    if (in_arm) others = shareCurve(before, outcome.contractions.front().second, outcome.arms);
    if (fits_curve && !others.empty()) {
      outcome.warnings.push_back("these arms keep the contraction curves of their own scenes: " +
                                 joinedNames(others));
    }
    outcome.calibration = estimation::calibrate(outcome.arms, options);
    if (in_arm && outcome.calibration->status == CalibrationStatus::kCalibrated) {
      estimation::ContractionFit& curve = outcome.contractions.front().second;
      CurveFit fit = fitCurveInArm(outcome.arms, options, curve, outcome.lengths, request.branch,
                                   *outcome.calibration);
      outcome.curve_in_arm = fit.verdict;
      if (fit.verdict.taken) {
        curve = std::move(fit.contraction);
        outcome.calibration = std::move(fit.calibration);
        putCurves();
        outcome.arms.front().arm = scene.arm;
      } else {
        outcome.warnings.push_back(
            "contraction " + outcome.contractions.front().first +
            " keeps the curve of the free lengths alone: " + fit.verdict.reason);
      }
    }
    const Calibration& calibration = *outcome.calibration;
    outcome.warnings.insert(outcome.warnings.end(), calibration.warnings.begin(),
                            calibration.warnings.end());
    if (calibration.status != CalibrationStatus::kCalibrated) {
      return refused(
          outcome, std::string(estimation::nameOf(calibration.status)) + ": " + calibration.reason);
    }
    outcome.least_tip_error = leastTipError(scene, outcome.arms.front(), calibration, options);
    changes = io::changesOf(scene, calibration, fitted, areCorners(data.captures));
  }
  changes.contractions = curves.contractions;
  changes.responses = curves.responses;
  changes.provenance = provenanceOf(path, sha256, overrides, request, sources, outcome);
  outcome.scene_text = io::calibratedSceneText(path, overrides, changes, sha256);
  if (fits_arm) {
    outcome.tip_error_before = medianTipError(scene, data.captures);
    const io::Scene calibrated = io::sceneOfText(outcome.scene_text, path);
    captures = seenFrom(calibrated, scene, std::move(captures));
    outcome.tip_error_after = medianTipError(calibrated, captures);
    const std::vector<std::string> apart = warningsOfScatter(calibrated, captures);
    outcome.warnings.insert(outcome.warnings.end(), apart.begin(), apart.end());
  }
  outcome.success = true;
  outcome.message = resultText(scene.name, outcome);
  return outcome;
}

std::string utcNow() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%SZ", &utc);
  return text.data();
}

}  // namespace helix_arm::procedures
