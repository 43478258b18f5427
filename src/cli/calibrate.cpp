#include <algorithm>

#include "bag/bag_captures.hpp"
#include "basics/quote.hpp"
#include "command.hpp"
#include "helix_arm/calibration/calibration_parameters.hpp"
#include "helix_arm/model/curve.hpp"
#include "io/document/atomic_file.hpp"
#include "io/document/number.hpp"
#include "io/scene/shipped_files.hpp"
#include "measurements.hpp"
#include "procedures/calibration_job.hpp"
#include "procedures/stand_calibration.hpp"

namespace helix_arm::cli {

namespace {

using estimation::ArmCaptures;
using estimation::Calibration;

const std::vector<std::string> kCurveNames = {"quintic", "table", "spline"};  // as in CurveKind

// Points of a fitted curve, for drawing.
constexpr int kCurvePoints = 100;

json curveInArmJson(const std::optional<procedures::CurveInArm>& found) {
  if (!found) return nullptr;
  return {{"taken", found->taken},           {"reason", valueIf(!found->taken, found->reason)},
          {"deviation_m", found->deviation}, {"standard_errors", found->standard_errors},
          {"pressure_pa", found->pressure},  {"probability", found->probability}};
}

json verdictJson(estimation::ResponseVerdict verdict, const std::string& reason) {
  static const char* const kWords[] = {"found", "none", "not_determined"};
  return {{"verdict", kWords[static_cast<std::size_t>(verdict)]}, {"reason", textOrNull(reason)}};
}

json estimateJson(const estimation::Estimate& one, double scale = 1.0) {
  return {{"value", scale * one.value}, {"standard_error", scale * one.standard_error}};
}

// The fitted contraction curves, with their samples and points to draw.
json contractionsJson(const procedures::CalibrationOutcome& outcome) {
  json all = json::array();
  for (const auto& [name, fit] : outcome.contractions) {
    json curve = json::array();
    json samples = listJson(outcome.lengths, [](const estimation::LengthSample& sample) -> json {
      return {{"pressure_pa", sample.pressure}, {"length_m", sample.length}};
    });
    if (fit.curve) {
      const model::Range& range = fit.curve->inputRange();
      for (int i = 0; i <= kCurvePoints; ++i) {
        const double p = range.lower + (range.upper - range.lower) * i / kCurvePoints;
        curve.push_back({{"pressure_pa", p}, {"length_m", fit.curve->lengthInside(p)}});
      }
    }
    all.push_back({{"name", name},
                   {"kind", kCurveNames[static_cast<std::size_t>(fit.kind)]},
                   {"in_arm", curveInArmJson(outcome.curve_in_arm)},
                   {"rms_m", fit.rms},
                   {"constrained", fit.constrained},
                   {"hysteresis_m", fit.hysteresis},
                   {"coefficients_m", fit.coefficients},
                   {"reference_pressure_pa", fit.reference_pressure},
                   {"samples", std::move(samples)},
                   {"curve", std::move(curve)}});
  }
  return all;
}

// The fitted response; null if none was asked for.
json responseJson(const std::optional<procedures::FittedResponse>& found) {
  if (!found) return nullptr;
  const estimation::ResponseFit& fit = found->fit;
  json reach = json::array(), weight = json::array();
  for (std::size_t j = 0; j < static_cast<std::size_t>(fit.response.play_count); ++j) {
    reach.push_back(estimateJson(fit.reach[j], 1e-3));
    weight.push_back(estimateJson(fit.weight[j]));
  }
  return {{"contractions", found->contractions},
          {"lag", verdictJson(fit.lag, fit.lag_reason)},
          {"play", verdictJson(fit.play, fit.play_reason)},
          {"rise_time_constant_s", estimateJson(fit.rise_time)},
          {"fall_time_constant_s", estimateJson(fit.fall_time)},
          {"play_kpa", std::move(reach)},
          {"play_weight", std::move(weight)},
          {"static_rms_m", fit.static_rms},
          {"rms_m", fit.rms}};
}

json modeJson(const procedures::FittedMode& found,
              const std::optional<procedures::FittedInertia>& inertia) {
  std::size_t next = 0;  // of the predictions, of which each release with ringing has one
  json rings = listJson(found.fit.rings, [&](const estimation::RingDown& ring) -> json {
    const auto trial = static_cast<std::size_t>(ring.trial);
    json out{{"trial", trial < found.trials.size() ? basics::printable(found.trials[trial]) : ""},
             {"time_s", ring.begin},
             {"frequency_hz", valueIf(ring.found(), estimateJson(ring.frequency))},
             {"damping", valueIf(ring.found(), estimateJson(ring.damping))},
             {"rms_m", ring.rms},
             {"rows", ring.rows},
             {"reason", textOrNull(ring.reason)}};
    if (inertia && ring.found()) {
      const dynamics::Vibration& predicted = inertia->fit.predicted[next++];
      out["predicted_frequency_hz"] = predicted.frequency;
      out["predicted_damping"] = predicted.damping;
    }
    return out;
  });
  const bool fitted = found.fit.fitted();
  return {{"frequency_hz", valueIf(fitted, estimateJson(found.fit.frequency))},
          {"damping", valueIf(fitted, estimateJson(found.fit.damping))},
          {"releases", std::move(rings)}};
}

json seriesJson(const estimation::SeriesFit& fit) {
  json choices = listJson(fit.choices, [](const estimation::Choice& one) -> json {
    return {
        {"part", one.part}, {"kept", one.kept}, {"gain_m", one.gain}, {"scatter_m", one.scatter}};
  });
  json out{{"rms_m", fit.rms},
           {"rms_without_offset_m", fit.rms_about_offset},
           {"held_out_rms_m", fit.held_out_rms},
           {"baseline_rms_m", fit.baseline_rms},
           {"baseline_held_out_rms_m", fit.baseline_held_out_rms},
           {"choices", std::move(choices)},
           {"rules", fit.rules}};
  if (!std::isnan(fit.rms_turn)) out["rms_rad"] = fit.rms_turn;
  return out;
}

struct CalibrateOptions {
  std::string scene, out, fit, curve, branch = "both";
  std::vector<std::string> data, also;
  procedures::CalibrationRequest request;
  bool verbose = false;
  std::optional<int> muscles;               // on a testing machine
  procedures::RecordedPressures pressures;  // of recordings of bodies
  double rest_offset_mm = 1e3 * request.rest_offset;
};

// SCENE2,DATA2.csv[,DATA3.csv...] of --also.
std::vector<std::string> partsOfAlso(const std::string& text) {
  std::vector<std::string> parts = wordsOf(text);
  refuseIf(parts.size() < 2, "--also ", text,
           " is not SCENE,DATA.csv: the scene of another arm and its data set");
  return parts;
}

procedures::CompanionArm companionOf(const std::string& text) {
  const std::vector<std::string> parts = partsOfAlso(text);
  io::Scene scene = io::loadScene(io::scenePath(parts.front()));
  requirePressureDriven(scene);
  procedures::CalibrationData data =
      ros_bridge::loadMeasurements(scene, {parts.begin() + 1, parts.end()}, {});
  return {std::move(scene), std::move(data)};
}

// --out must not overwrite a data set, or a scene with its comments.
void requireOutputOfItsOwn(const CalibrateOptions& options) {
  std::vector<std::string> inputs = options.data;
  inputs.push_back(options.scene);
  for (const std::string& text : options.also) {
    const std::vector<std::string> parts = partsOfAlso(text);
    inputs.insert(inputs.end(), parts.begin(), parts.end());
  }
  requireNoInput(options.out, inputs);
  requireYaml(options.out);
}

const char* kindOf(const estimation::Capture& capture) {
  static const char* const kNames[] = {"curvature", "twists", "tag_poses", "tag_corners"};
  return kNames[capture.reading.index()];
}

json armsJson(const procedures::CalibrationOutcome& outcome) {
  json arms = json::array();
  std::size_t index = 0;
  const Calibration* const calibration = outcome.calibration ? &*outcome.calibration : nullptr;
  for (const ArmCaptures& arm : outcome.arms) {
    json captures = json::array();
    for (const estimation::Capture& capture : arm.captures) {
      json entry{{"capture", capture.number},
                 {"pressure_pa", capture.pressure},
                 {"kind", kindOf(capture)}};
      if (const auto* reading = std::get_if<estimation::CurvatureReading>(&capture.reading)) {
        entry["measured_rad"] = reading->curvature;
      }
      // Captures that the calibration rejected have no residual.
      if (calibration != nullptr && index < calibration->captures.size()) {
        const estimation::CaptureResidual& residual = calibration->captures[index];
        const model::Twists& shape = calibration->shapes[index];
        if (entry.contains("measured_rad")) entry["model_rad"] = model::curvatureOf(shape.col(0));
        entry["twist"] = shape.transpose();
        entry["rms"] = residual.rms;
        entry["outlier_tags"] = residual.outlier_tags;
        entry["outlier"] = residual.outlier;
        entry["gain_nats"] = residual.gain;
        const std::vector<model::Twists>& held_out = calibration->held_out_shapes;
        if (entry.contains("measured_rad") && index < held_out.size()) {
          entry["held_out_rad"] = model::curvatureOf(held_out[index].col(0));
        }
      }
      ++index;
      captures.push_back(std::move(entry));
    }
    arms.push_back({{"name", arm.name}, {"captures", std::move(captures)}});
  }
  return arms;
}

json heldOutJson(const std::optional<estimation::HeldOut>& held_out) {
  if (!held_out) return nullptr;
  const json groups = listJson(held_out->groups, [](const auto& group) -> json {
    return {{"label", group.label}, {"error", group.error}};
  });
  return {{"error", held_out->error}, {"in_sample", held_out->in_sample}, {"groups", groups}};
}

json combinationsJson(const std::vector<estimation::Combination>& combinations) {
  return listJson(combinations, [](const estimation::Combination& one) -> json {
    json exponents = json::object();
    for (const auto& power : one.powers) exponents[power.parameter] = power.exponent;
    return {{"name", one.name},
            {"value", one.value},
            {"relative_error", one.relative_error},
            {"identifiable", one.identifiable},
            {"exponents", std::move(exponents)}};
  });
}

json parameterJson(const estimation::Parameter& one) {
  return {{"parameter", one.name},
          {"value", one.value},
          {"standard_error", one.standard_error},
          {"identifiable", one.identifiable},
          {"initial", one.initial},
          {"unit", one.unit}};
}

json reportOf(const io::Scene& scene, const procedures::CalibrationOutcome& outcome,
              const CalibrateOptions& options) {
  json result{{"scene", scene.name},
              {"success", outcome.success},
              {"reason", valueIf(!outcome.success, outcome.message)},
              {"tip_error_before_m", outcome.tip_error_before},
              {"tip_error_after_m", outcome.tip_error_after},
              {"parameters", json::object()},
              {"contractions", contractionsJson(outcome)},
              {"response", responseJson(outcome.response)},
              {"arms", armsJson(outcome)},
              {"held_out_error", nullptr},
              {"suspects", outcome.suspects},
              {"warnings", outcome.warnings},
              {"out", outcome.success ? textOrNull(options.out) : json()}};
  for (const estimation::Parameter& one : procedures::parametersOf(outcome)) {
    result["parameters"][one.name] = without(parameterJson(one), {"parameter"});
  }
  if (outcome.mode) result["mode"] = modeJson(*outcome.mode, outcome.inertia);
  if (outcome.series && outcome.success) result["series"] = seriesJson(*outcome.series);
  if (outcome.calibration) {
    const Calibration& calibration = *outcome.calibration;
    result["status"] = estimation::nameOf(calibration.status);
    result["correlation"] = calibration.correlation;
    result["combinations"] = combinationsJson(calibration.combinations);
    result["rms"] = calibration.rms;
    result["error_unit"] = calibration.error_unit;
    result["held_out"] = {{"by_pressure", heldOutJson(calibration.by_pressure)},
                          {"by_arm", heldOutJson(calibration.by_arm)}};
    if (calibration.by_pressure) result["held_out_error"] = calibration.by_pressure->error;
    if (outcome.least_tip_error) {
      result["least_tip_error"] = {{"K_kappa_m2", outcome.least_tip_error->K_kappa},
                                   {"error", outcome.least_tip_error->error}};
    }
    result["next_pressures_pa"] =
        listJson(calibration.next_pressures, [](const Eigen::VectorXd& each) { return each; });
  }
  return result;
}

void printParameters(const procedures::CalibrationOutcome& outcome, std::ostream& out) {
  for (const std::string& warning : outcome.warnings) out << "# warning " << warning << "\n";
  if (!outcome.success) out << "# reason " << outcome.message << "\n";
  for (const auto& [name, fit] : outcome.contractions) {
    out << "# contraction " << name << " rms_m " << exact(fit.rms) << "\n";
  }
  if (!outcome.calibration && !outcome.response && !outcome.mode && !outcome.series) return;
  if (outcome.calibration && outcome.calibration->by_pressure) {
    out << "# held_out_error " << exact(outcome.calibration->by_pressure->error) << " "
        << outcome.calibration->error_unit << "\n";
  }
  CsvTable table(out, {"parameter", "unit", "initial", "value", "standard_error", "identifiable"});
  for (const auto& one : procedures::parametersOf(outcome)) table.add(parameterJson(one));
}

// Adds the unit of errors to their keys.
void nameUnit(json& tree, const std::string& suffix) {
  for (const char* key : {"rms", "error", "in_sample"}) {
    if (!tree.is_object() || !tree.contains(key)) continue;
    tree[key + suffix] = tree[key];
    tree.erase(key);
  }
  for (json& below : tree) {
    if (below.is_structured()) nameUnit(below, suffix);
  }
}

// Quantities that the data determine, without the single readings.
json shownOf(const procedures::CalibrationOutcome& outcome, const json& report, bool verbose) {
  json shown = without(report, {"arms", "suspects", "samples", "curve", "coefficients_m",
                                "held_out_error", "error_unit"});
  if (!verbose) shown = without(shown, {"groups"});
  shown["summary"] = textOrNull(procedures::tipErrorText(outcome));
  const procedures::Determined found = procedures::determinedOf(outcome);
  json& parameters = shown["parameters"] = json::array();
  for (const estimation::Parameter& one : found.parameters) {
    parameters.push_back(procedures::textOf(one));
  }
  if (!outcome.success) shown.erase("parameters");
  if (!found.tags.empty()) {
    shown["notes"].push_back("places of the tags " + io::listOf(found.tags) +
                             " are fitted, too (--format csv gives their numbers)");
  }
  // Usual, as of tags that no capture shows; what was asked for has a warning.
  if (verbose && found.omitted > 0) {
    shown["notes"].push_back(std::to_string(found.omitted) +
                             " parameters that the data do not determine " +
                             (outcome.series ? "are held by their priors" : "keep their values") +
                             " (--format csv lists them)");
  }
  if (outcome.calibration) {
    const std::string unit = outcome.calibration->error_unit;
    if (shown.contains("least_tip_error")) {
      nameUnit(shown["least_tip_error"], unit == "rad" ? "_rad" : "_m");
    }
    nameUnit(shown, "_" + unit);
    json& products = shown["combinations"] = json::array();
    for (const estimation::Combination& one : outcome.calibration->combinations) {
      products.push_back((one.identifiable ? "well known: " : "badly known: ") +
                         procedures::textOf(one));
    }
  }
  return shown;
}

// Curve and stiffness from a testing machine.
int runStand(const CalibrateOptions& options, const GlobalOptions& global, const io::Scene& scene) {
  std::vector<std::string> words = wordsOf(options.fit);
  std::sort(words.begin(), words.end());
  refuseIf(words != std::vector<std::string>{"K_eps", "contraction"},
           "--muscles takes readings of a testing machine, which determine curve and stiffness "
           "together; give --fit contraction,K_eps");
  refuseIf(!options.also.empty() || !options.curve.empty() || options.branch != "both",
           "--muscles excludes --also, --curve and --branch");
  const procedures::StandOutcome outcome =
      procedures::calibrateStand(options.scene, overridesOf(global), options.request.contraction,
                                 *options.muscles, procedures::loadStand(options.data));
  const estimation::StandFit& fit = outcome.fit;
  json curve = json::array();
  for (std::size_t k = 0; k < fit.pressures.size() && fit.law; ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    curve.push_back({{"pressure_pa", fit.pressures[k]},
                     {"length_m", fit.lengths[i]},
                     {"length_error_m", fit.lengths_error[i]},
                     {"K_eps_n", fit.K_eps[i]},
                     {"K_eps_error_n", fit.K_eps_error[i]}});
  }
  const bool fitted = !outcome.scene_text.empty();
  if (fitted && !options.out.empty()) io::writeFileAtomically(options.out, outcome.scene_text);
  json report{{"scene", scene.name},
              {"success", fitted},
              {"reason", textOrNull(fit.reason)},
              {"contraction", outcome.contraction},
              {"muscles", *options.muscles},
              {"rows", outcome.all.residual.size()},
              {"rms_n", valueIf(fitted, fit.rms)},
              {"span_n", valueIf(fitted, outcome.all.span)},
              {"loop_n", outcome.all.loop},
              {"held_out",
               {{"rms_n", valueIf(fitted, fit.held_out_rms)},
                {"parts", listJson(fit.held_out,
                                   [](const auto& part) -> json {
                                     return {{"part", part.first}, {"rms_n", part.second}};
                                   })}}},
              {"curve", curve},
              {"out", fitted ? textOrNull(options.out) : json()}};
  const json shown = options.verbose ? report : without(report, {"parts"});
  printResult(global.format, report, shown,
              Csv{{"pressure_pa", "length_m", "length_error_m", "K_eps_n", "K_eps_error_n"},
                  "curve",
                  {"rms_n", "span_n", "loop_n", "reason"}});
  return fitted ? kDone : kNotPossible;
}

int run(const CalibrateOptions& options, const GlobalOptions& global) {
  const io::Scene scene = loadScene(options.scene, global);
  requirePressureDriven(scene);
  requireOutputOfItsOwn(options);
  if (options.muscles) return runStand(options, global, scene);
  procedures::CalibrationRequest request = options.request;
  request.fit = wordsOf(options.fit);
  if (!options.curve.empty()) {
    const auto name = std::find(kCurveNames.begin(), kCurveNames.end(), options.curve);
    request.curve = static_cast<estimation::CurveKind>(name - kCurveNames.begin());
  }
  if (options.branch == "rising") request.branch = estimation::Branch::kRising;
  if (options.branch == "falling") request.branch = estimation::Branch::kFalling;
  request.rest_offset = 1e-3 * options.rest_offset_mm;
  const procedures::CalibrationData data =
      ros_bridge::loadMeasurements(scene, options.data, {}, options.pressures);
  std::vector<procedures::CompanionArm> companions;
  for (const std::string& text : options.also) companions.push_back(companionOf(text));
  const procedures::CalibrationOutcome outcome =
      procedures::runCalibration(options.scene, overridesOf(global), request, data, companions);
  if (outcome.success && !options.out.empty()) {
    io::writeFileAtomically(options.out, outcome.scene_text);
  }
  const json report = reportOf(scene, outcome, options);
  printResult(global.format, report, shownOf(outcome, report, options.verbose),
              [&outcome](std::ostream& out) { printParameters(outcome, out); });
  return outcome.success ? kDone : kNotPossible;
}

// Options for a fit that stays beyond its noise, and for the length of its report.
void addVerdictOptions(CLI::App& command, CalibrateOptions& options) {
  addOption(command, "--apply-suspect", options.request.apply_suspect,
            "calibrate with the captures as this suspect of the result corrects them, counted from "
            "1; default 0, as given");
  command.add_flag(
      "--force", options.request.force,
      "write the scene even if a suspect explains 90 % of what is beyond the noise, or "
      "the fit predicts worse than before, or stays beyond five times the noise");
  command.add_flag("--verbose", options.verbose,
                   "in text, the error of each pressure and arm that was held out as well");
}

// Options for contraction curves.
void addCurveOptions(CLI::App& command, CalibrateOptions& options) {
  addOption(command, "--muscles", options.muscles,
            "the data are of a testing machine with so many equal muscles in parallel, for --fit "
            "contraction,K_eps",
            CLI::Range(1, 1000));
  addOption(
      command, "--contraction", options.request.contraction,
      "the scene's contraction curve that free lengths replace, needed if it has several; the only "
      "one that a series of the tip changes, else all");
  addOption(command, "--curve", options.curve,
            "kind of contraction curve: spline (fitted to free lengths and captures together), "
            "quintic or table (to free lengths alone); default spline with captures, else quintic",
            CLI::IsMember(kCurveNames));
  addOption(command, "--branch", options.branch,
            "branch of the free lengths: both, rising or falling",
            CLI::IsMember({"both", "rising", "falling"}), kShowDefault);
}

}  // namespace

void addCalibrate(Commands& commands) {
  auto [command, options] =
      commands.add<CalibrateOptions>("calibrate", "fit a scene to measurements", run);
  addScene(command, options.scene);
  addOption(
      command, "DATA", options.data,
      "data sets (# comments, a header that names units, rows) of curvatures (pressure_1_kpa "
      ".., curvature_rad), tag poses (capture, pressure_1_kpa .., tag, x_m .. qw), tag "
      "corners (capture, pressure_1_kpa .., tag, x1_px, y1_px .. y4_px), free lengths "
      "(pressure_kpa, length_m), with --muscles readings of a testing machine (pressure_kpa, "
      "length_m, force_n; tension is positive), or series of the tip (time_s, pressure_1_kpa .., "
      "x_m, y_m, "
      "z_m, optionally qx .. qw; for a mode without pressures, too); captures with columns of "
      "a load that hangs on the arm (load_mass_kg or load_force_x_n .. load_force_z_n, world "
      "frame; load_s: sections from the base, default the tip); or rosbags with "
      "tag_detections, pressure_measured and pressure_command (bodies: body_poses or NAME/pose), "
      "or recordings of bodies (time_s, NAME_x_m .. NAME_qw, or exports of Motive or Vicon): each "
      "time the arm is at rest is one capture",
      kRequired);
  addOption(command, "--fit", options.fit,
            "parameters to fit, comma list of " + estimation::fitWordsText() + "; default " +
                estimation::wordOf(estimation::kDefaultFitGroup));
  addOption(command, "--out", options.out, "scene file to write, completely or not at all");
  addOption(command, "--also", options.also,
            "another arm with the same stiffness, as SCENE,DATA.csv; --set does not apply to it; "
            "repeatable")
      ->allow_extra_args(false);
  addPressures(command, options.pressures);
  addCurveOptions(command, options);
  addOption(
      command, "--rest-offset-mm", options.rest_offset_mm,
      "expected standard deviation of the tip's offset from trial to trial, per axis [mm], of "
      "a series; 0: none",
      kShowDefault);
  addOption(command, "--curvature-noise-rad", options.request.curvature_noise,
            "expected standard deviation of a curvature [rad], default 0.02; that of tags is the "
            "scene's, vision.*");
  addVerdictOptions(command, options);
  command.footer(
      R"(json: tip_error_before_m and tip_error_after_m (median over the captures with tags),
parameters {name: {value, standard_error, identifiable, initial, unit}},
combinations [{name, value, relative_error, identifiable, exponents}] of stiffness,
response, mode (if mode, mass or damping is asked for: frequency_hz, damping, releases
[{trial, time_s, frequency_hz, damping, rms_m, rows, reason; with mass or damping also
predicted_frequency_hz and predicted_damping of the fitted arm}]), correlation, rms, held_out_error (each pressure predicted by a fit without it) with
error_unit, suspects [{cause, where, explains, remedy}] (what usually explains a fit that stays
beyond its noise, best first), held_out {by_pressure, by_arm}, contractions, arms [{name, captures}],
next_pressures_pa (most informative pressures to measure next), warnings, out, reason
(exit code 1).
scripts/plot_report draws it. csv: one row per parameter.
With --muscles, json: rms_n, span_n (of the measured forces), loop_n (width of the
hysteresis loop, in force), held_out {rms_n, parts [{part, rms_n}]} (each data set predicted
by a fit to the others; of a single one, each tenth), curve [{pressure_pa, length_m (free),
length_error_m, K_eps_n (of one muscle), K_eps_error_n}], rows, contraction, out, reason.
csv: one row per pressure of the curve.)");
}

}  // namespace helix_arm::cli
