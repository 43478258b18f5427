#include "helix_arm/procedures/calibration_job.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <map>
#include <set>
#include <stdexcept>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/calibrated_scene.hpp"
#include "helix_arm/io/number.hpp"
#include "helix_arm/procedures/captures.hpp"

namespace helix_arm::procedures {
namespace {

using estimation::ArmCaptures;
using estimation::Calibration;
using estimation::CalibrationOptions;
using estimation::CalibrationStatus;
using estimation::LengthScaling;

const char* const kWords[] = {
    "stiffness",         "K_kappa",     "K_gamma",   "K_tau", "K_eps", "length_scale",
    "length_scale_each", "contraction", "placement", "base",  "tags",  "bleed"};

// The words of a request.
class FitWords {
 public:
  explicit FitWords(const std::vector<std::string>& words) : words_(words.begin(), words.end()) {
    if (words_.empty()) words_.insert("stiffness");
    for (const std::string& word : words_) {
      if (std::find(std::begin(kWords), std::end(kWords), word) != std::end(kWords)) continue;
      std::string known;
      for (const char* const one : kWords) known += (known.empty() ? "" : ", ") + std::string(one);
      throw std::invalid_argument("there is no \"" + word + "\" to fit; expected some of " + known);
    }
  }

  bool has(const std::string& word) const { return words_.count(word) > 0; }
  bool any(std::initializer_list<const char*> words) const {
    return std::any_of(words.begin(), words.end(), [this](const char* one) { return has(one); });
  }

 private:
  std::set<std::string> words_;
};

bool areCorners(const std::vector<estimation::Capture>& captures) {
  return !captures.empty() && std::holds_alternative<std::vector<estimation::CornerObservation>>(
                                  captures.front().reading);
}

CalibrationOptions optionsOf(const io::Scene& scene, const CalibrationRequest& request,
                             const FitWords& words, const CalibrationData& data) {
  CalibrationOptions options;
  options.K_kappa = words.any({"stiffness", "K_kappa"});
  options.K_gamma = words.any({"stiffness", "K_gamma"});
  options.K_tau = words.has("K_tau");
  options.K_eps = words.has("K_eps");
  const bool scaled =
      words.has("length_scale") || (words.has("contraction") && data.lengths.empty());
  if (scaled) options.length_scale = LengthScaling::kCommon;
  if (words.has("length_scale_each")) options.length_scale = LengthScaling::kEach;
  options.base = words.any({"placement", "base"});
  options.tags = words.any({"placement", "tags"});
  // It is there whether one asks for it or not, and what ignores it is wrong by many of its errors.
  options.bleed = words.has("bleed") || areCorners(data.captures);
  // Placements alone are not to depend on how good the model is.
  options.free_shapes = !options.K_kappa && !options.K_gamma && !options.K_tau && !options.K_eps &&
                        options.length_scale == LengthScaling::kNone;

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

// Which of the scene's curves the data of free lengths is of.
std::optional<std::string> curveName(const io::Scene& scene, const std::string& asked,
                                     std::string& message) {
  std::string names;
  for (const std::string& name : scene.contractions) {
    names += (names.empty() ? "" : ", ") + name;
    if (name == asked) return name;
  }
  if (asked.empty() && scene.contractions.size() == 1) return scene.contractions.front();
  message = asked.empty() ? "scene " + scene.name + " has the contractions " + names +
                                "; say which of them was measured"
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
    for (const estimation::Parameter& one : calibration.parameters) {
      out.parameters.push_back(
          {one.name, one.value, one.standard_error, one.identifiable, one.unit});
    }
    out.rms = calibration.rms;
    if (calibration.by_pressure) out.held_out_error = calibration.by_pressure->error;
    out.error_unit = calibration.error_unit;
  } else {
    out.rms = outcome.contractions.front().second.rms;
    out.error_unit = "m";
  }
  return out;
}

io::SceneCalibration changesOf(const io::Scene& scene, const Calibration& calibration,
                               const CalibrationOptions& options, const FitWords& words,
                               bool corners) {
  io::SceneCalibration changes;
  changes.stiffness = calibration.stiffness;
  changes.K_eps = calibration.K_eps;
  if (options.length_scale != LengthScaling::kNone) changes.length_scale = calibration.length_scale;
  if (options.base && corners) changes.X_CB = scene.X_CB() * calibration.X_B0B;
  if (options.base && !corners) changes.X_BF = calibration.X_B0B.inverse() * scene.X_BF;
  if (options.tags) changes.tags = calibration.layout;
  if (words.any({"placement", "bleed"})) changes.bleed = calibration.bleed;
  return changes;
}

// Shapes fitted to the tags of each capture by itself, where they determine one, with the
// placements that a calibration found.
ArmCaptures asTwists(const io::Scene& scene, const ArmCaptures& data,
                     const Calibration& calibration) {
  ArmCaptures out = data;
  out.captures.clear();
  model::Stiffness stiffness = calibration.stiffness.value();
  stiffness.kappa = data.arm.actuator(0).stiffness.kappa;
  out.arm = data.arm.withStiffness(stiffness);
  if (calibration.K_eps)
    std::fill(out.load->K_eps.begin(), out.load->K_eps.end(), *calibration.K_eps);
  estimation::TwistFitter fitter(calibration.layout, data.arm.sectionCount(), scene.vision.fit);
  const lie::SE3 X_BB0 = calibration.X_B0B.inverse(), X_CB = data.X_CB * calibration.X_B0B;
  for (std::size_t i = 0; i < data.captures.size(); ++i) {
    if (calibration.captures[i].outlier) continue;
    const estimation::Capture& capture = data.captures[i];
    const model::Shape& model = calibration.curves[i];
    estimation::Capture twists = capture;
    const auto* corners = std::get_if<std::vector<estimation::CornerObservation>>(&capture.reading);
    auto* poses = std::get_if<std::vector<estimation::PoseObservation>>(&twists.reading);
    if (poses != nullptr) {
      for (estimation::PoseObservation& seen : *poses) seen.X_BT = X_BB0 * seen.X_BT;
    }
    const estimation::TwistFit& fit = corners != nullptr
                                          ? fitter.fitCold(*corners, X_CB, data.focal, model)
                                          : fitter.fitCold(*poses, model);
    if (fit.status != estimation::FitStatus::kConverged) continue;
    twists.reading = estimation::TwistReading{fit.twists, fit.covariance};
    out.captures.push_back(std::move(twists));
  }
  return out;
}

// By the paper's definition, which knows of no other parameter.
std::optional<estimation::LeastTipError> leastTipError(const io::Scene& scene,
                                                       const ArmCaptures& data,
                                                       const Calibration& calibration,
                                                       const CalibrationOptions& options) {
  const bool fitted = options.K_kappa && calibration.stiffness;
  if (!fitted || options.length_scale != LengthScaling::kNone) return std::nullopt;
  const bool curvatures =
      std::holds_alternative<estimation::CurvatureReading>(data.captures.front().reading);
  if (curvatures) return estimation::fitLeastTipError({data});
  // In its plane a twist has no covariance across it.
  if (data.planar) return std::nullopt;
  return estimation::fitLeastTipError({asTwists(scene, data, calibration)});
}

// Data that is given twice would count twice.
std::optional<std::string> repeated(const std::vector<io::Provenance::Data>& sources) {
  std::map<std::string, std::string> files;
  for (const io::Provenance::Data& source : sources) {
    const auto [known, is_new] = files.emplace(source.sha256, source.file);
    if (!is_new) {
      return source.file + " holds the same as " + known->second + "; give each data set once";
    }
  }
  return std::nullopt;
}

// The captures of one more arm, but those that show nothing of it.
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

CalibrationOutcome refused(CalibrationOutcome outcome, const std::string& message) {
  outcome.success = false;
  outcome.message = message;
  return outcome;
}

}  // namespace

void addCaptures(std::vector<estimation::Capture> captures, const std::string& file,
                 CalibrationData& data) {
  std::set<int> taken;
  for (const estimation::Capture& one : data.captures) taken.insert(one.number);
  const bool meet = std::any_of(captures.begin(), captures.end(),
                                [&taken](const auto& one) { return taken.count(one.number) > 0; });
  if (meet) {
    const int offset = *taken.rbegin();
    for (estimation::Capture& one : captures) one.number += offset;
    data.warnings.push_back("captures of " + file + " are called by their number + " +
                            std::to_string(offset));
  }
  std::move(captures.begin(), captures.end(), std::back_inserter(data.captures));
}

CalibrationData loadCalibrationData(const io::Scene& scene, const std::vector<std::string>& paths) {
  CalibrationData out;
  for (const std::string& path : paths) {
    const io::DataSet data = io::loadDataSet(path);
    int count = 0;
    if (kindOf(data) == DataKind::kLengths) {
      const std::vector<estimation::LengthSample> samples = loadLengths(data);
      out.lengths.insert(out.lengths.end(), samples.begin(), samples.end());
      count = static_cast<int>(samples.size());
    } else {
      LoadedCaptures read = loadCaptures(scene, data);
      count = static_cast<int>(read.captures.size());
      if (!read.unknown_tags.empty()) {
        out.warnings.push_back(
            path + " has tags that the scene has not: " + io::listOf(read.unknownIds()));
      }
      addCaptures(std::move(read.captures), path, out);
    }
    out.sources.push_back({path, data.sha256, count});
  }
  return out;
}

CalibrationOutcome runCalibration(const std::string& path,
                                  const std::vector<io::Override>& overrides,
                                  const CalibrationRequest& request, const CalibrationData& data,
                                  const std::vector<CompanionArm>& companions) {
  const FitWords words(request.fit);
  CalibrationOutcome outcome;
  outcome.warnings = data.warnings;
  std::vector<io::Provenance::Data> sources = data.sources;
  for (const CompanionArm& one : companions) {
    sources.insert(sources.end(), one.data.sources.begin(), one.data.sources.end());
    outcome.warnings.insert(outcome.warnings.end(), one.data.warnings.begin(),
                            one.data.warnings.end());
    if (!one.data.lengths.empty()) {
      return refused(outcome, "the data of " + one.scene.name +
                                  " holds free lengths; give those of the scene alone");
    }
  }
  if (const auto twice = repeated(sources)) return refused(outcome, *twice);
  io::Scene scene = io::loadScene(path, overrides);
  const std::string sha256 = scene.sha256;
  io::SceneCalibration curves;
  const bool fits_arm =
      words.any({"stiffness", "K_kappa", "K_gamma", "K_tau", "K_eps", "length_scale",
                 "length_scale_each", "placement", "base", "tags", "bleed"}) ||
      (words.has("contraction") && data.lengths.empty());
  if (!words.has("contraction") && !data.lengths.empty()) {
    return refused(outcome,
                   "the data holds free lengths, but no contraction is to be fitted; leave it out, "
                   "or fit contraction as well");
  }
  if (words.has("contraction") && !data.lengths.empty()) {
    std::string message;
    const auto name = curveName(scene, request.contraction, message);
    if (!name) return refused(outcome, message);
    estimation::ContractionFit fit = estimation::fitContraction(data.lengths, request.curve);
    outcome.contractions.emplace_back(*name, fit);
    if (fit.status != estimation::ContractionFitStatus::kFitted) {
      return refused(outcome, "contraction " + *name + ": " + fit.reason);
    }
    curves.contractions = outcome.contractions;
  }
  if (!fits_arm && !companions.empty()) {
    return refused(outcome, "other arms share the stiffness, but none is to be fitted");
  }
  io::SceneCalibration changes;
  if (fits_arm) {
    // What follows is of the arm with its new curves.
    if (!curves.contractions.empty()) {
      curves.provenance = provenanceOf(path, sha256, overrides, request, sources, outcome);
      scene = io::sceneOfText(io::calibratedSceneText(path, overrides, curves, sha256), path);
      if (!companions.empty()) {
        outcome.warnings.push_back("the other arms keep the curves of their own scenes");
      }
    }
    addArm(scene, data.captures, outcome);
    for (const CompanionArm& one : companions) addArm(one.scene, one.data.captures, outcome);
    for (const ArmCaptures& arm : outcome.arms) {
      if (arm.captures.empty()) return refused(outcome, "there is no capture of " + arm.name);
    }
    const CalibrationOptions options = optionsOf(scene, request, words, data);
    outcome.calibration = estimation::calibrate(outcome.arms, options);
    const Calibration& calibration = *outcome.calibration;
    outcome.warnings.insert(outcome.warnings.end(), calibration.warnings.begin(),
                            calibration.warnings.end());
    if (calibration.status != CalibrationStatus::kCalibrated) {
      return refused(
          outcome, std::string(estimation::nameOf(calibration.status)) + ": " + calibration.reason);
    }
    outcome.least_tip_error = leastTipError(scene, outcome.arms.front(), calibration, options);
    changes = changesOf(scene, calibration, options, words, areCorners(data.captures));
  }
  changes.contractions = curves.contractions;
  changes.provenance = provenanceOf(path, sha256, overrides, request, sources, outcome);
  outcome.scene_text = io::calibratedSceneText(path, overrides, changes, sha256);
  outcome.success = true;
  outcome.message = "calibrated " + scene.name;
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
