#include "calibration_job.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <functional>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <utility>
#include <variant>
#include <vector>

#include "basics/median.hpp"
#include "basics/pi.hpp"
#include "basics/text.hpp"
#include "calibration/series_orientation.hpp"
#include "captures.hpp"
#include "curve_in_arm.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/calibration/calibration.hpp"
#include "helix_arm/calibration/calibration_parameters.hpp"
#include "helix_arm/io/calibrated_scene.hpp"
#include "helix_arm/io/scene.hpp"
#include "io/document/number.hpp"

namespace helix_arm::procedures {

namespace {

using estimation::ArmCaptures;
using estimation::Calibration;
using estimation::CalibrationOptions;
using estimation::CalibrationStatus;
using estimation::FitParameter;
using estimation::ResponseFit;
using estimation::ResponseVerdict;

// Whether it is of tags, and shows none.
bool isEmpty(const estimation::Capture& capture) {
  const auto* poses = std::get_if<PosesOfTags>(&capture.reading);
  const auto* corners = std::get_if<CornersOfTags>(&capture.reading);
  return (poses != nullptr && poses->empty()) || (corners != nullptr && corners->empty());
}

// Captures whose poses of tags, if they have some, are seen from another base.
std::vector<estimation::Capture> movedBy(const lie::SE3& X_B1B,
                                         std::vector<estimation::Capture> captures) {
  for (estimation::Capture& capture : captures) {
    auto* const poses = std::get_if<PosesOfTags>(&capture.reading);
    if (poses == nullptr) continue;
    for (estimation::PoseObservation& one : *poses) one.X_BT = X_B1B * one.X_BT;
  }
  return captures;
}

// Twists fitted to the tags of each capture separately, if they determine one, with the calibrated
// placements.
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
  std::vector<estimation::Capture> seen = movedBy(calibration.X_B0B.inverse(), data.captures);
  for (std::size_t i = 0; i < seen.size(); ++i) {
    if (calibration.captures[i].outlier) continue;
    const model::Shape& model = calibration.curves[i];
    const auto* const corners = std::get_if<CornersOfTags>(&seen[i].reading);
    const estimation::TwistFit& fit =
        corners != nullptr
            ? fitter.fitCold(*corners, data.X_CB * calibration.X_B0B, data.camera.focal(), model)
            : fitter.fitCold(std::get<PosesOfTags>(seen[i].reading), model);
    if (fit.status != estimation::FitStatus::kConverged) continue;
    out.captures.push_back(std::move(seen[i]));
    out.captures.back().reading = estimation::TwistReading{fit.twists, fit.covariance};
  }
  return out;
}

// See CalibrationOutcome::least_tip_error. Nothing if K_kappa or its tips do not follow from the
// calibration.
// @param data  captures of the arm, as used by the calibration.
std::optional<estimation::LeastTipError> leastTipError(
    const io::Scene& scene, const ArmCaptures& data, const Calibration& calibration,
    const estimation::CalibrationOptions& options) {
  // The paper's definition has no other parameters.
  const bool fitted = options.fits(FitParameter::kKappa) && calibration.stiffness;
  const bool scaled =
      std::any_of(options.fit.begin(), options.fit.end(), [](FitParameter parameter) {
        const estimation::FitParameterInfo& one = estimation::infoOf(parameter);
        return one.aboutShape() && !one.isStiffness();
      });
  if (!fitted || scaled) return std::nullopt;
  const bool curvatures =
      std::holds_alternative<estimation::CurvatureReading>(data.captures.front().reading);
  if (curvatures) return estimation::fitLeastTipError({data});
  // The covariance of a planar twist is singular.
  if (data.planar) return std::nullopt;
  return estimation::fitLeastTipError({asTwists(scene, data, calibration)});
}

// Motion of a direction that counts, relative to the largest motion.
constexpr double kLeastMotion = 0.5;

// The response as it is written: the fit's, but of the scene what the data do not determine.
model::Response written(const ResponseFit& fit, const model::Response& before) {
  model::Response out = fit.response;
  if (fit.lag == ResponseVerdict::kNotDetermined) {
    out.rise_time = before.rise_time;
    out.fall_time = before.fall_time;
  }
  if (fit.play == ResponseVerdict::kNotDetermined) {
    out.play_count = before.play_count;
    out.plays = before.plays;
  }
  return out;
}

std::optional<std::string> faultOf(const CalibrationRequest& request, const CalibrationData& data) {
  if (data.lengths.empty() && data.tips.empty()) {
    return "a response needs readings in the order taken; expected free lengths (pressure_kpa, "
           "length_m) or a series of the tip (time_s, pressure_1_kpa .., x_m, y_m, z_m)";
  }
  if (!data.tips.empty() && data.tips.history.input.cols() == 0) {
    return "the series of the tip has no pressures; expected columns pressure_1_kpa .. for a "
           "response";
  }
  if (!data.lengths.empty() && !data.tips.empty()) {
    return "the data hold free lengths and a series of the tip; expected one of them for a "
           "response";
  }
  if (request.branch != estimation::Branch::kBoth) {
    return "a response explains the rising and the falling branch; expected both of them, but one "
           "was chosen";
  }
  return std::nullopt;
}

// The positions along the directions of the largest motions: across an arm. Those along it vary
// with the square of its bend and tell little of what muscles remember. NaN where there is none.
Eigen::MatrixXd largestMotions(const Eigen::MatrixXd& position) {
  std::vector<Eigen::Index> seen;
  for (Eigen::Index row = 0; row < position.rows(); ++row) {
    if (position.row(row).allFinite()) seen.push_back(row);
  }
  if (seen.empty()) return position;
  const Eigen::RowVectorXd mean = position(seen, Eigen::all).colwise().mean();
  const Eigen::MatrixXd about = position(seen, Eigen::all).rowwise() - mean;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(about.transpose() * about);
  const Eigen::Vector3d& squares = axes.eigenvalues();  // ascending
  const double least = kLeastMotion * kLeastMotion * squares[2];
  const auto count = (squares.array() >= least).count();
  return (position.rowwise() - mean) * axes.eigenvectors().rightCols(count);
}

// The numbers that were found.
std::vector<estimation::Parameter> numbersOf(const ResponseFit& fit,
                                             const model::Response& before) {
  std::vector<estimation::Parameter> out;
  const auto add = [&out](const std::string& name, const char* unit, double initial,
                          const estimation::Estimate& one) {
    out.push_back({name, unit, initial, one.value, one.standard_error, true});
  };
  if (fit.lag == ResponseVerdict::kFound) {
    add("rise_time_constant", "s", before.rise_time, fit.rise_time);
    add("fall_time_constant", "s", before.fall_time, fit.fall_time);
  }
  for (int j = 0; j < fit.response.play_count; ++j) {
    const auto play = static_cast<std::size_t>(j);
    const std::string number = std::to_string(j + 1);
    add("play_" + number, "Pa", before.plays[play].reach, fit.reach[play]);
    add("play_weight_" + number, "", before.plays[play].weight, fit.weight[play]);
  }
  return out;
}

// Largest RMS turn between a series and the fitted arm [rad].
constexpr double kMostTurn = 0.8;

// Before a capture, whose arm is at rest, effective pressures are averaged for so long [s].
constexpr double kEffectiveMean = 0.5;
// A series reaches so far beyond its last row [s].
constexpr double kSeriesHold = 0.5;

// Mean of the effective beyond the measured pressures before a time; nothing if no trial of the
// series covers it.
std::optional<Eigen::VectorXd> beyondAt(double time, const model::InputHistory& history,
                                        const Eigen::MatrixXd& beyond) {
  const std::vector<double>& times = history.time;
  for (std::size_t begin = 0, end = 0; begin < times.size(); begin = end) {
    for (end = begin + 1; end < times.size() && !history.starts_anew[end];) ++end;
    if (time < times[begin] || time > times[end - 1] + kSeriesHold) continue;
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(beyond.cols());
    int count = 0;
    for (std::size_t k = begin; k < end && times[k] <= time; ++k) {
      if (times[k] <= time - kEffectiveMean) continue;
      sum += beyond.row(static_cast<Eigen::Index>(k)).transpose();
      ++count;
    }
    if (count > 0) return sum / count;
  }
  return std::nullopt;
}

bool areCorners(const std::vector<estimation::Capture>& captures) {
  return !captures.empty() && std::holds_alternative<CornersOfTags>(captures.front().reading);
}

// Whether the data are motions of the tip alone, to which an arm can be fitted.
bool isSeries(const CalibrationData& data) {
  return data.captures.empty() && data.lengths.empty() && !data.tips.empty() &&
         data.tips.history.input.cols() > 0;
}

// Parameters that the words of a request select for this data.
std::set<FitParameter> fittedOf(const CalibrationRequest& request, const CalibrationData& data) {
  std::set<FitParameter> fitted =
      estimation::fitParametersOf(request.fit, areCorners(data.captures));
  // Captures of an arm determine the error of its curves, but not the curves themselves.
  if (data.lengths.empty() && !isSeries(data) && fitted.erase(FitParameter::kContraction) > 0) {
    fitted.insert(FitParameter::kLengthScale);
  }
  return fitted;
}

bool isOfRing(FitParameter parameter) {
  return parameter == FitParameter::kRingRadius || parameter == FitParameter::kRingPhase;
}
bool isOfArm(FitParameter parameter) {
  return estimation::infoOf(parameter).block.has_value() || isOfRing(parameter);
}

// Prior of the base about where alignmentOf() places the frame of poses.
constexpr estimation::BasePrior kPlacedFrame = {0.05, 0.1};

CalibrationOptions optionsOf(const io::Scene& scene, const CalibrationRequest& request,
                             const std::set<FitParameter>& fitted, const CalibrationData& data) {
  CalibrationOptions options;
  options.fit.clear();
  // Placements that are fitted alone must not depend on the accuracy of the model.
  options.free_shapes = true;
  for (const estimation::FitParameterInfo& info : estimation::fitParameters()) {
    const bool asked = fitted.count(info.parameter) > 0;
    if (asked && info.aboutShape()) options.free_shapes = false;
    const bool implied = info.implied() && areCorners(data.captures);
    if (info.block && (asked || implied)) options.fit.insert(info.parameter);
  }
  // The last request wins: per actuator rather than one scale for all.
  if (options.fits(FitParameter::kLengthScaleEach)) options.fit.erase(FitParameter::kLengthScale);

  const estimation::TwistFitOptions& expected = scene.vision.fit;
  const auto choose = [](const char* what, double asked, double usual) {
    basics::requireValue(std::isfinite(asked) && asked >= 0, "calibration", what, asked,
                         "a finite value >= 0, 0 for the scene's");
    return asked > 0 ? asked : usual;
  };
  options.curvature_noise =
      choose("the curvature noise", request.curvature_noise, options.curvature_noise);
  options.corner_noise = choose("the corner noise", request.corner_noise, expected.corner_noise);
  options.position_noise =
      choose("the position noise", request.position_noise, expected.position_noise);
  options.rotation_noise =
      choose("the rotation noise", request.rotation_noise, expected.rotation_noise);
  options.robust_scale = expected.robust_scale;
  options.tag_prior = scene.tag_prior;
  options.border_shift_prior = expected.border_shift_prior;
  if (scene.hasBodies()) options.base_prior = kPlacedFrame;
  return options;
}

// The motion X that takes the measured poses of bodies nearest to those of the model: of positions
// about their mean, in units of the arm's length, and of rotations. With it, how much larger the
// measured positions spread.
struct Alignment {
  lie::SE3 X;
  double spread;
};
Alignment alignmentOf(const io::Scene& scene, const std::vector<estimation::Capture>& captures) {
  std::vector<std::pair<lie::SE3, lie::SE3>> pairs;  // measured, of the model
  Eigen::Vector3d seen = Eigen::Vector3d::Zero(), expected = seen;
  for (const estimation::Capture& capture : captures) {
    const auto* const poses = std::get_if<PosesOfTags>(&capture.reading);
    const statics::Solution model = modelUnder(scene, capture.payload).solve(capture.pressure);
    if (poses == nullptr || !model.converged()) continue;
    const std::vector<lie::SE3> places = estimation::tagPoses(*scene.tags, model.shape);
    for (const estimation::PoseObservation& one : *poses) {
      pairs.emplace_back(one.X_BT, places[static_cast<std::size_t>(one.tag)]);
      seen += one.X_BT.translation;
      expected += pairs.back().second.translation;
    }
  }
  if (pairs.empty()) return {lie::SE3(), 1.0};
  seen /= static_cast<double>(pairs.size());
  expected /= static_cast<double>(pairs.size());
  const bool rotations = scene.vision.fit.rotation_noise > 0;
  const double scale = 1 / (scene.arm.restLength() * scene.arm.restLength());
  Eigen::Matrix3d moments = Eigen::Matrix3d::Zero();
  double seen_spread = 0, expected_spread = 0;
  for (const auto& [measured, modelled] : pairs) {
    const Eigen::Vector3d a = measured.translation - seen, b = modelled.translation - expected;
    moments += scale * b * a.transpose();
    if (rotations) moments += modelled.rotation * measured.rotation.transpose();
    seen_spread += a.squaredNorm();
    expected_spread += b.squaredNorm();
  }
  const Eigen::Matrix3d R = estimation::nearestRotation(moments);
  return {{R, expected - R * seen}, std::sqrt(seen_spread / expected_spread)};
}

// A calibration in its phases. Each of them says why the request is refused, or nothing.
class CalibrationJob {
 public:
  CalibrationJob(const std::string& path, const std::vector<io::Override>& overrides,
                 const CalibrationRequest& request, const CalibrationData& data,
                 const std::vector<CompanionArm>& companions)
      : path_(path),
        overrides_(overrides),
        request_(request),
        data_(data),
        companions_(companions),
        fitted_(fittedOf(request, data)),
        timed_(std::any_of(data.captures.begin(), data.captures.end(),
                           [](const auto& capture) { return capture.time.has_value(); })) {}

  CalibrationOutcome run() {
    using Job = CalibrationJob;
    for (const auto phase : {&Job::gatherSources, &Job::readScene, &Job::fitResponse, &Job::fitMode,
                             &Job::fitInertia, &Job::fitCurve, &Job::fitArm, &Job::write}) {
      if (const Refusal refusal = (this->*phase)()) {
        outcome_.message = *refusal;
        return std::move(outcome_);
      }
    }
    outcome_.success = true;
    outcome_.message = resultText(scene_->name, outcome_);
    return std::move(outcome_);
  }

 private:
  using Refusal = std::optional<std::string>;

  Refusal gatherSources() {
    outcome_.warnings = data_.warnings;
    sources_ = data_.sources;
    for (const CompanionArm& one : companions_) {
      sources_.insert(sources_.end(), one.data.sources.begin(), one.data.sources.end());
      warn(one.data.warnings);
      if (!one.data.lengths.empty()) {
        return "the data of " + one.scene.name +
               " holds free lengths; give only those of the scene's own arm";
      }
    }
    return repeatedSource(sources_);
  }

  Refusal readScene() {
    scene_ = io::loadScene(path_, overrides_);
    sha256_ = scene_->sha256;
    captures_ = data_.captures;
    if (scene_->hasBodies() && fitted_.count(FitParameter::kBase) > 0) {
      if (const Refusal refusal = placeFrame()) return refusal;
    }
    if (!fitsCurve() && !fitsResponse() && !data_.lengths.empty()) {
      return "the data holds free lengths, but no contraction is fitted; leave it out, or fit "
             "contraction as well";
    }
    const bool of_ring = std::any_of(fitted_.begin(), fitted_.end(), isOfRing);
    if (of_ring && (!ofSeries() || scene_->planar)) {
      return "ring_radius and ring_phase are fitted to a series of the tip (time_s, pressure_1_kpa "
             ".., x_m, y_m, z_m) of an arm that is not planar; leave them out";
    }
    if (of_ring) io::requireRings(path_, overrides_);
    // A series also gives the effective pressures of captures whose times are known.
    const bool follows = !data_.tips.empty() && data_.tips.history.input.cols() > 0 && timed_;
    if (!fitsResponse() && !fitsMode() && !fitsInertia() && !data_.tips.empty() && !follows &&
        !ofSeries()) {
      return "the data holds a series of the tip, but no response is fitted; leave it out, or fit "
             "response as well";
    }
    const bool of_curve = fitsResponse() && (data_.tips.empty() || !request_.contraction.empty());
    if (ofSeries() ? request_.contraction.empty() : !fitsCurve() && !of_curve) return std::nullopt;
    return chooseCurve(request_.contraction);
  }

  // The frame of the poses of bodies, from these alone: it may be another one than before.
  Refusal placeFrame() {
    const Alignment found = alignmentOf(*scene_, captures_);
    constexpr double kMillimetres = 1e3, kAbout = 3;
    if (found.spread > kMillimetres / kAbout && found.spread < kMillimetres * kAbout) {
      return basics::messageOf("the positions of the bodies spread ", std::round(found.spread),
                               " times as far as those of the model: they are in millimetres; "
                               "expected metres");
    }
    scene_->X_BF = found.X * scene_->X_BF;
    captures_ = movedBy(found.X, std::move(captures_));
    return std::nullopt;
  }

  // The contraction curve that the free lengths belong to.
  Refusal chooseCurve(const std::string& asked) {
    std::vector<std::string> known;
    for (const auto& [name, response] : scene_->contractions) {
      known.push_back(name);
      if (name == asked || (asked.empty() && scene_->contractions.size() == 1)) name_ = name;
    }
    if (name_) return std::nullopt;
    return "scene " + scene_->name +
           (asked.empty()
                ? " has the contractions " + basics::joined(known) +
                      "; name the one that was measured"
                : " has no contraction " + asked + "; expected one of " + basics::joined(known));
  }

  // To free lengths or to a series of the tip, whichever the data hold. What these do not determine
  // stays as that of the first curve.
  Refusal fitResponse() {
    if (!fitsResponse() || ofSeries()) return std::nullopt;
    if (auto fault = faultOf(request_, data_)) return fault;
    FittedResponse found;
    for (const auto& [one, response] : scene_->contractions) {
      if (!name_ || one == *name_) found.contractions.push_back(one);
    }
    const model::Response& before = scene_->contractions.at(found.contractions.front());
    if (data_.tips.empty()) {
      const Eigen::MatrixXd& length = data_.lengths.reading;
      found.fit =
          estimation::fitResponse(data_.lengths.history, (length(0, 0) - length.array()).matrix());
    } else {
      found.fit = estimation::fitResponseToPositions(data_.tips.history,
                                                     largestMotions(data_.tips.reading));
    }
    if (!found.fit.fitted()) return "response: " + found.fit.failure;
    found.response = written(found.fit, before);
    found.parameters = numbersOf(found.fit, before);
    for (const std::string* reason : {&found.fit.lag_reason, &found.fit.play_reason}) {
      if (!reason->empty()) warn({"response: " + *reason});
    }
    if (before.slow_weight > 0) {
      warn(
          {"response: the scene's slow state (slow_time_constant_s, slow_weight) is removed, "
           "since lag and play were found without one; fit a word of the arm as well, such as "
           "stiffness, to a series of the tip to find it again"});
    }
    for (const std::string& one : found.contractions) {
      changes_.responses.emplace_back(one, found.response);
    }
    outcome_.response = std::move(found);
    return std::nullopt;
  }

  Refusal fitMode() {
    if (!fitsMode() && !fitsInertia()) return std::nullopt;
    const ResponseSeries& tips = data_.tips;
    if (tips.empty()) {
      return "mode, mass and damping need a series of the tip (time_s, x_m, y_m, z_m) through a "
             "release or a step";
    }
    outcome_.mode = FittedMode{estimation::fitMode(tips.history, tips.reading), tips.trials, {}};
    const estimation::ModeFit& fit = outcome_.mode->fit;
    if (!fit.fitted()) return "mode: " + fit.failure;
    if (!fitsMode()) return std::nullopt;
    const estimation::Mode before = scene_->follow.mode.value_or(estimation::Mode{});
    const estimation::Estimate &frequency = fit.frequency, &damping = fit.damping;
    outcome_.mode->parameters = {
        {"mode_hz", "Hz", before.frequency, frequency.value, frequency.standard_error, true},
        {"mode_damping", "", before.damping, damping.value, damping.standard_error, true}};
    changes_.mode = estimation::Mode{fit.frequency.value, fit.damping.value};
    return std::nullopt;
  }

  Refusal fitInertia() {
    if (!fitsInertia()) return std::nullopt;
    const auto& load = scene_->model.load();
    const double mass = load ? std::accumulate(load->mass.begin(), load->mass.end(), 0.0) : 0.0;
    if (!(mass > 0)) {
      return "mass and damping need load.mass_kg and arm.stiffness.K_eps_n; put in what a scale "
             "and a pull on one actuator show, since a vibration tells their ratio alone";
    }
    constexpr double kUsualTime = 0.01;  // of damping that the scene does not tell [s]
    dynamics::MotionConfig config = scene_->dynamics;
    dynamics::StrainTimes& times = config.damping;
    const double before = times.bend;
    if (!(times.bend > 0)) times = {kUsualTime, kUsualTime, kUsualTime, kUsualTime};
    FittedInertia found;
    found.fit = estimation::fitInertia(scene_->arm, scene_->planar, *load, config,
                                       data_.tips.history, outcome_.mode->fit,
                                       {fits(FitParameter::kMass), fits(FitParameter::kDamping)});
    if (!found.fit.failure.empty()) return "mass and damping: " + found.fit.failure;
    const auto [mass_factor, mass_error] = found.fit.mass;
    const auto [factor, error] = found.fit.damping;
    if (fits(FitParameter::kMass)) {
      found.parameters.push_back(
          {"mass_kg", "kg", mass, mass_factor * mass, mass_error * mass, true});
      changes_.mass_factor = mass_factor;
    }
    if (fits(FitParameter::kDamping)) {
      found.parameters.push_back(
          {"damping_bend_s", "s", before, factor * times.bend, error * times.bend, true});
      changes_.damping = dynamics::StrainTimes{factor * times.stretch, factor * times.shear,
                                               factor * times.twist, factor * times.bend};
    }
    if (data_.tips.history.input.cols() == 0) {
      warn(
          {"mass and damping: the series has no pressures; its releases count as at the lower "
           "limits"});
    }
    outcome_.inertia = std::move(found);
    return std::nullopt;
  }

  Refusal fitCurve() {
    if (!fitsCurve() || ofSeries()) return std::nullopt;
    const model::Response response =
        outcome_.response ? outcome_.response->response : scene_->contractions.at(*name_);
    remembers_ = !response.instant();
    const bool with_arm = fitsArm() && !data_.captures.empty();
    const estimation::CurveKind usual =
        with_arm && !remembers_ ? estimation::CurveKind::kSpline : estimation::CurveKind::kQuintic;
    outcome_.lengths = effectiveSamples(data_.lengths, response);
    estimation::ContractionFit fit = estimation::fitContraction(
        outcome_.lengths, {request_.curve.value_or(usual), request_.branch});
    if (fit.curve && remembers_) {
      fit = continuedTo(data_.lengths.history.input.maxCoeff(), std::move(fit));
    }
    outcome_.contractions.emplace_back(*name_, fit);
    if (!fit.curve) return "contraction " + *name_ + ": " + fit.reason;
    changes_.contractions = outcome_.contractions;
    return std::nullopt;
  }

  // From here on, the arm has its new curves.
  void putCurves() {
    changes_.contractions = outcome_.contractions;
    changes_.provenance = provenance();
    scene_ = io::sceneOfText(io::calibratedSceneText(path_, overrides_, changes_, sha256_), path_);
  }

  // Captures get effective pressures in place of the measured ones, as far as a series was recorded
  // through them. Without responses of the arm, nothing changes.
  void takeEffective() {
    const model::Arm& arm = scene_->arm;
    model::ArmResponse response(arm);
    if (response.instant()) return;
    const model::InputHistory& history = data_.tips.history;
    Eigen::MatrixXd beyond(history.rows(), arm.actuatorCount());
    for (Eigen::Index row = 0; row < history.rows(); ++row) {
      response.follow(history, row);
      beyond.row(row) = response.effective().transpose() - history.input.row(row);
    }
    std::vector<int> unknown;
    for (estimation::Capture& capture : captures_) {
      const auto more = capture.time ? beyondAt(*capture.time, history, beyond) : std::nullopt;
      if (more) {
        capture.pressure = arm.clamped(capture.pressure + *more);
      } else {
        unknown.push_back(capture.number);
      }
    }
    if (unknown.empty()) return;
    warn(
        {"captures that the series of the tip does not cover are taken at their measured "
         "pressures: " +
         io::listOf(unknown)});
  }

  // Without the captures that show no tag of the arm.
  void addArm(const io::Scene& scene, const std::vector<estimation::Capture>& captures) {
    ArmCaptures arm = makeArmCaptures(scene, {});
    std::vector<int> empty;
    for (const estimation::Capture& capture : captures) {
      if (isEmpty(capture)) {
        empty.push_back(capture.number);
      } else {
        arm.captures.push_back(capture);
      }
    }
    if (!empty.empty()) {
      warn({"captures of " + arm.name + " without a tag of the arm: " + io::listOf(empty)});
    }
    const auto same =
        std::count_if(outcome_.arms.begin(), outcome_.arms.end(),
                      [&scene](const ArmCaptures& one) { return one.name == scene.name; });
    if (same > 0) arm.name += " (" + std::to_string(same + 1) + ")";
    outcome_.arms.push_back(std::move(arm));
  }

  Refusal gatherArms() {
    if (timed_ && !data_.tips.empty() && data_.tips.history.input.cols() > 0) takeEffective();
    addArm(*scene_, captures_);
    for (const CompanionArm& one : companions_) addArm(one.scene, one.data.captures);
    for (const ArmCaptures& arm : outcome_.arms) {
      if (arm.captures.empty()) return "no capture of " + arm.name + " was given";
    }
    return std::nullopt;
  }

  Refusal fitArm() {
    if (request_.apply_suspect != 0 &&
        (!fitsArm() || (fitsCurve() && !ofSeries()) || !request_.errors)) {
      return "a suspect is corrected in captures or a series to which an arm is fitted with its "
             "errors; leave it out of a fit of curves or responses alone, and of one without "
             "errors";
    }
    if (!fitsArm()) {
      if (companions_.empty()) return std::nullopt;
      return "other arms share the stiffness, but it is not fitted; fit it, or leave out the other "
             "arms";
    }
    if (ofSeries()) return fitArmToSeries();
    const model::Arm before = scene_->arm;
    if (fitsCurve() || fitsResponse()) putCurves();
    if (auto refusal = gatherArms()) return refusal;
    CalibrationOptions options = optionsOf(*scene_, request_, fitted_, data_);
    // The effective pressures of the captures are unknown where the muscle remembers.
    const bool in_arm = fitsCurve() && !remembers_ && !options.free_shapes &&
                        outcome_.contractions.front().second.spline.has_value();
    std::vector<std::string> others;
    for (std::size_t a = 1; a < outcome_.arms.size(); ++a) others.push_back(outcome_.arms[a].name);
    options.errors = request_.errors || in_arm;
    if (in_arm) others = shareCurve(before, outcome_.contractions.front().second, outcome_.arms);
    if (fitsCurve() && !others.empty()) {
      warn({"these arms keep the contraction curves of their own scenes: " +
            basics::joined(others)});
    }
    if (auto refusal = suspect(options)) return refusal;
    outcome_.calibration = estimation::calibrate(outcome_.arms, options);
    if (in_arm && outcome_.calibration->status == CalibrationStatus::kCalibrated) {
      decideOnCurve(options);
    }
    const Calibration& calibration = *outcome_.calibration;
    warn(calibration.warnings);
    if (calibration.status != CalibrationStatus::kCalibrated) {
      return std::string(estimation::nameOf(calibration.status)) + ": " + calibration.reason +
             firstSuspect();
    }
    outcome_.least_tip_error = leastTipError(*scene_, outcome_.arms.front(), calibration, options);
    io::addChanges(*scene_, calibration, fitted_, areCorners(data_.captures), changes_);
    return std::nullopt;
  }

  // Names the usual mistakes that explain the captures better, and corrects one if asked to.
  Refusal suspect(const CalibrationOptions& options) {
    // A curve that is fitted as well may be what is wrong.
    if (request_.errors && !fitsCurve()) {
      outcome_.suspects = estimation::suspectsOf(outcome_.arms, options);
    }
    return applySuspect("captures give", "captures", [this](const estimation::Suspect& chosen) {
      if (chosen.corrected.empty()) return false;
      outcome_.arms = chosen.corrected;
      captures_ = outcome_.arms.front().captures;
      return true;
    });
  }

  // Warns of the suspects, or corrects the one that is asked for.
  // @param correct  of the chosen one: false if it is not one of the data.
  Refusal applySuspect(const char* who_gives, const char* data,
                       const std::function<bool(const estimation::Suspect&)>& correct) {
    const int asked = request_.apply_suspect, count = static_cast<int>(outcome_.suspects.size());
    if (asked == 0) {
      warn(textsOf(outcome_.suspects));
      return std::nullopt;
    }
    if (asked < 1 || asked > count) {
      return basics::messageOf("suspect ", asked, " is not among the ", count, " that the ",
                               who_gives, "; leave it out to see them");
    }
    const estimation::Suspect& suspect = outcome_.suspects[static_cast<std::size_t>(asked - 1)];
    if (!correct(suspect)) {
      return basics::messageOf("suspect ", asked, ", ", suspect.cause, ", is not of the ", data,
                               ": ", suspect.remedy);
    }
    warn({basics::messageOf("calibrated as if without ", suspect.cause, " (", suspect.where, ")")});
    return std::nullopt;
  }

  // As the end of a sentence; empty without any.
  std::string firstSuspect() const {
    const std::vector<std::string> suspects = textsOf(outcome_.suspects);
    return suspects.empty() ? "" : "; " + suspects.front();
  }

  Refusal refusedFor(const std::string& reason) const {
    return reason + firstSuspect() + "; force writes the scene all the same";
  }

  // Why the fitted arm is not that of the captures.
  Refusal refuseFar() const {
    if (request_.force) return std::nullopt;
    if (outcome_.series) return refuseFarSeries();
    if (!outcome_.calibration) return std::nullopt;
    const double noise = outcome_.calibration->noise_scale;
    if (request_.apply_suspect == 0 && estimation::isCertain(outcome_.suspects, noise)) {
      return refusedFor("a usual mistake explains the captures far better than the fitted arm");
    }
    const double beyond = noise / outcome_.calibration->usual_scale;
    constexpr double kMostNoise = estimation::kFarNoise;
    if (beyond > kMostNoise) {
      return refusedFor(
          basics::messageOf("the readings are ", std::round(10 * beyond) / 10,
                            " times as far from the fitted arm as their noise and the "
                            "usual errors of tags and pressures; expected at most ",
                            kMostNoise));
    }
    return std::nullopt;
  }

  // Why the calibrated scene would be worse than before.
  Refusal refuseWorse() const {
    // The median error of tips, which the fit does not minimise, hardly changes in a sound arm.
    constexpr double kWorse = 1.2, kWorseBy = 0.5e-3;  // [m]
    if (request_.force || !outcome_.calibration || !outcome_.tip_error_before ||
        !outcome_.tip_error_after ||
        *outcome_.tip_error_after <= kWorse * *outcome_.tip_error_before + kWorseBy) {
      return std::nullopt;
    }
    return refusedFor("the fitted arm predicts worse than before, " + tipErrorText(outcome_));
  }

  // The curve that captures and free lengths have in common is taken where it explains both.
  void decideOnCurve(const CalibrationOptions& options) {
    estimation::ContractionFit& curve = outcome_.contractions.front().second;
    CurveFit fit = fitCurveInArm(outcome_.arms, options, curve, outcome_.lengths, request_.branch,
                                 *outcome_.calibration);
    outcome_.curve_in_arm = fit.verdict;
    if (!fit.verdict.taken) {
      warn({"contraction " + outcome_.contractions.front().first +
            " keeps the curve of the free lengths alone: " + fit.verdict.reason});
      return;
    }
    curve = std::move(fit.contraction);
    outcome_.calibration = std::move(fit.calibration);
    putCurves();
    outcome_.arms.front().arm = scene_->arm;
  }

  Refusal fitArmToSeries() {
    if (!companions_.empty()) {
      return "other arms share the stiffness of captures, but the data is a series of the tip; "
             "leave the other arms out";
    }
    basics::requireValue(std::isfinite(request_.rest_offset) && request_.rest_offset >= 0,
                         "calibration", "the rest offset", request_.rest_offset,
                         "a finite value >= 0, 0 for none");
    estimation::SeriesOptions options;
    options.arm = optionsOf(*scene_, request_, fitted_, data_);
    if (fitsCurve()) options.arm.fit.insert(FitParameter::kContraction);
    options.response = fitsResponse();
    options.rest_offset = request_.rest_offset;
    options.curve = request_.contraction;
    options.ring_radius = fits(FitParameter::kRingRadius);
    options.ring_phase = fits(FitParameter::kRingPhase);
    const bool of_geometry = fits(FitParameter::kBase) && fitsCurve() && !scene_->planar;
    options.phases = options.ring_phase || (of_geometry && io::hasRingsOnly(path_, overrides_));
    estimation::TipSeries tips = soundRowsOf(ofArm(data_.tips));
    if (fitsCurve()) lowerLimits(tips);
    const estimation::SeriesPrior prior = priorOf(*scene_);
    outcome_.series = estimation::fitSeries(prior, tips, options);
    if (auto refusal = suspectSeries(prior, options, tips)) return refusal;
    const estimation::SeriesFit& fit = *outcome_.series;
    if (!fit.failure.empty()) return fit.failure + firstSuspect();
    warnOfLimits();
    takeSeriesFit(fit, options);
    return std::nullopt;
  }

  // Changes of the scene by the fit of a series, and what is to be said of it.
  void takeSeriesFit(const estimation::SeriesFit& fit, const estimation::SeriesOptions& options) {
    if (fit.held_out_rms > estimation::kMostOfBaseline * fit.baseline_held_out_rms) {
      const auto millimetres = [](double length) { return std::round(1e4 * length) / 10; };
      warn({basics::messageOf("left-out parts of the series are ", millimetres(fit.held_out_rms),
                              " mm (RMS) off the fitted arm, but ",
                              millimetres(fit.baseline_held_out_rms),
                              " mm off a cubic of the pressures; ", estimation::kBeyondBaseline)});
    }
    changes_.stiffness = fit.stiffness;
    changes_.bending = fit.bending;
    changes_.K_eps = fit.K_eps;
    changes_.length_scale = fit.length_scale;
    if (fit.stroke_scale) changes_.numbers[FitParameter::kStrokeScaleEach] = *fit.stroke_scale;
    changes_.ring_radius = fit.ring_radius;
    changes_.ring_phase = fit.ring_phase;
    if (!fit.orientation_fault.empty()) {
      warn({"the orientations (qx .. qw) contradict the positions and are left out: " +
            fit.orientation_fault});
    }
    if (!fit.order_fault.empty()) warn({"positions: " + fit.order_fault});
    if (fits(FitParameter::kBase)) {
      const bool of_tags = scene_->tags && !scene_->hasBodies() && !scene_->motion_capture.X_BF;
      (of_tags ? changes_.X_BF : changes_.motion_capture.X_BF) = fit.X_BF;
    }
    changes_.motion_capture.R_TM = fit.R_TM;
    changes_.motion_capture.p_TM = fit.p_TM;
    changes_.motion_capture.beam = fit.beam;
    outcome_.contractions = changes_.contractions = fit.curves;
    for (const auto& [name, response] : scene_->contractions) {
      if (options.response) changes_.responses.emplace_back(name, fit.response);
    }
  }

  // Without the rows that cannot be positions of the tip, which are named.
  estimation::TipSeries soundRowsOf(estimation::TipSeries tips) {
    const estimation::SeriesFaults faults = estimation::faultyRows(tips);
    const auto leaveOut = [&](const std::vector<Eigen::Index>& rows, const char* what) {
      if (rows.empty()) return;
      std::string where;
      for (std::size_t k = 0; k < rows.size() && k < 3 && !tips.history.time.empty(); ++k) {
        where += (k == 0 ? ", at time_s " : ", ") +
                 io::formatNumber(tips.history.time[static_cast<std::size_t>(rows[k])]);
      }
      warn({basics::messageOf(rows.size(), rows.size() == 1 ? " row is " : " rows are ", what,
                              where, rows.size() > 3 ? ", ..: left out" : ": left out")});
      for (const Eigen::Index row : rows) tips.position.row(row).setConstant(std::nan(""));
    };
    leaveOut(faults.zero, "exactly at the origin, as where tracking is lost");
    leaveOut(faults.frozen, "frozen while the pressures change");
    leaveOut(faults.far, "far from the rows about them");
    return tips;
  }

  // Names the usual mistakes of a recording that the arm does not fit, and corrects one if asked
  // to.
  Refusal suspectSeries(const estimation::SeriesPrior& prior,
                        const estimation::SeriesOptions& options, estimation::TipSeries& tips) {
    constexpr double kAsNoise = 1.5;  // times the error of a cubic of the pressures
    estimation::SeriesFit& fit = *outcome_.series;
    const bool sound = fit.failure.empty() && fit.rms <= kAsNoise * fit.baseline_rms &&
                       !(fit.rms_turn > kMostTurn);
    if (request_.errors && !sound) {
      outcome_.suspects = estimation::suspectsOf(prior, tips, options);
    }
    return applySuspect("series gives", "recording", [&](const estimation::Suspect& chosen) {
      if (!chosen.corrected_series) return false;
      tips = *chosen.corrected_series;
      fit = estimation::fitSeries(prior, tips, options);
      return true;
    });
  }

  // Why the fitted arm is not that of the series.
  Refusal refuseFarSeries() const {
    const estimation::SeriesFit& fit = *outcome_.series;
    // A cubic of the pressures leaves its error, and the geometry of a sound arm may be off.
    constexpr double kUsual = 0.02;  // of the arm's length
    const double usual = std::hypot(fit.baseline_rms, kUsual * scene_->arm.restLength());
    if (request_.apply_suspect == 0 && estimation::isCertain(outcome_.suspects, fit.rms / usual)) {
      return refusedFor("a usual mistake explains the series far better than the fitted arm");
    }
    if (fit.rms > estimation::kFarNoise * usual) {
      return refusedFor(basics::messageOf("the fitted arm is ", std::round(1e4 * fit.rms) / 10,
                                          " mm (RMS) off the series, where a "
                                          "cubic of the pressures is ",
                                          std::round(1e4 * fit.baseline_rms) / 10,
                                          " mm off; expected "
                                          "at most ",
                                          estimation::kFarNoise,
                                          " times that and 2 % of the arm's length"));
    }
    if (fit.rms_turn > kMostTurn) {
      return refusedFor(basics::messageOf(
          "the orientations are ", std::round(fit.rms_turn * 180 / basics::kPi),
          " deg (RMS) off the fitted "
          "arm; expected those of the tip's frame, x along the arm, or positions alone"));
    }
    return std::nullopt;
  }

  // Beyond the pressures of a series a curve would be a guess.
  void lowerLimits(const estimation::TipSeries& tips) {
    // Parts of a limit: reached, and too little of it to be meant; [Pa].
    constexpr double kReached = 0.9, kLeast = 0.5, kStep = 100.0;
    std::map<std::string, std::pair<double, double>> reached;  // by curve: limit, highest [Pa]
    for (int i = 0; i < scene_->arm.actuatorCount(); ++i) {
      const model::Actuator& one = scene_->arm.actuator(i);
      auto& [limit, highest] = reached[one.curve];
      limit = std::max(limit, one.limits.upper);
      highest = std::max(highest, tips.history.input.col(i).maxCoeff());
    }
    const std::size_t before = overrides_.size();
    for (const auto& [curve, pressures] : reached) {
      const auto [limit, highest] = pressures;
      const bool is_free = request_.contraction.empty() || request_.contraction == curve;
      if (!is_free || highest < kLeast * limit || highest >= kReached * limit) continue;
      const double lowered = kStep * std::ceil(highest / kStep);
      warn({basics::messageOf("max_pressure_kpa is lowered from ", io::kilopascals(limit), " to ",
                              io::kilopascals(lowered), " where the curve is ", curve,
                              ": the series goes no higher, and beyond it the curve would be a "
                              "guess; record up to the limit to keep it")});
      overrides_ = io::withLimit(path_, overrides_, curve, lowered);
    }
    if (overrides_.size() > before) scene_ = io::loadScene(path_, overrides_);
  }

  // A few readings are noise about a limit.
  void warnOfLimits() {
    constexpr double kMostBeyond = 0.02;
    const Eigen::MatrixXd& pressure = data_.tips.history.input;
    for (int i = 0; i < scene_->arm.actuatorCount(); ++i) {
      const model::Actuator& one = scene_->arm.actuator(i);
      const double share = (pressure.col(i).array() > one.limits.upper).cast<double>().mean();
      if (share <= kMostBeyond) continue;
      warn({basics::messageOf("pressure_", i + 1, "_kpa is above the limit of ", one.name, ", ",
                              io::kilopascals(one.limits.upper), " kPa, in ",
                              std::round(100 * share), " % of the rows, which count as at it")});
    }
  }

  void compareTips() {
    outcome_.tip_error_before =
        medianTipError(*scene_, request_.apply_suspect != 0 ? captures_ : data_.captures);
    const io::Scene calibrated = io::sceneOfText(outcome_.scene_text, path_);
    const std::vector<estimation::Capture> captures =
        movedBy(calibrated.X_BF * scene_->X_BF.inverse(), std::move(captures_));
    outcome_.tip_error_after = medianTipError(calibrated, captures);
    warn(warningsOfScatter(calibrated, captures));
  }

  Refusal write() {
    changes_.provenance = provenance();
    Refusal refusal = refuseFar();
    try {
      outcome_.scene_text = io::calibratedSceneText(path_, overrides_, changes_, sha256_);
    } catch (const io::DocumentError&) {
      if (refusal) return refusal;  // which says why a value is what no scene can have
      throw;
    }
    if (fitsArm() && !ofSeries()) compareTips();
    if (!refusal) refusal = refuseWorse();
    if (refusal) outcome_.scene_text.clear();
    return refusal;
  }

  bool fits(FitParameter parameter) const { return fitted_.count(parameter) > 0; }
  bool fitsCurve() const { return fits(FitParameter::kContraction); }
  bool fitsResponse() const { return fits(FitParameter::kResponse); }
  bool fitsMode() const { return fits(FitParameter::kMode); }
  bool fitsInertia() const { return fits(FitParameter::kMass) || fits(FitParameter::kDamping); }
  bool ofSeries() const { return fitsArm() && isSeries(data_); }
  bool fitsArm() const { return std::any_of(fitted_.begin(), fitted_.end(), isOfArm); }
  void warn(const std::vector<std::string>& warnings) {
    outcome_.warnings.insert(outcome_.warnings.end(), warnings.begin(), warnings.end());
  }
  io::Provenance provenance() const {
    io::Provenance out = provenanceOf(path_, overrides_, sha256_, sources_);
    if (outcome_.calibration) {
      const Calibration& calibration = *outcome_.calibration;
      out.rms = calibration.rms;
      if (calibration.by_pressure) out.held_out_error = calibration.by_pressure->error;
      out.error_unit = calibration.error_unit;
    } else {
      out.rms = outcome_.series                  ? outcome_.series->rms
                : !outcome_.contractions.empty() ? outcome_.contractions.front().second.rms
                : outcome_.response              ? outcome_.response->fit.rms
                                                 : outcome_.mode->fit.rms;
      out.error_unit = "m";
    }
    for (const estimation::Parameter& one : parametersOf(outcome_)) {
      if (!isJudged(one)) continue;
      out.parameters.push_back(
          {one.name, one.value, one.standard_error, one.identifiable, one.unit});
    }
    if (!outcome_.calibration) return out;
    for (const estimation::Combination& one : outcome_.calibration->combinations) {
      io::Provenance::Combination combination{{}, one.relative_error, one.identifiable};
      for (const estimation::Combination::Power& power : one.powers) {
        combination.exponents[power.parameter] = power.exponent;
      }
      out.combinations.push_back(std::move(combination));
    }
    return out;
  }

  const std::string& path_;
  std::vector<io::Override> overrides_;  // with limits at what a series reaches
  const CalibrationRequest& request_;
  const CalibrationData& data_;
  const std::vector<CompanionArm>& companions_;
  const std::set<FitParameter> fitted_;
  const bool timed_;  // some captures know their times

  std::vector<io::Provenance::Data> sources_;
  std::optional<io::Scene> scene_;  // with its new curves, once the arm is fitted
  std::string sha256_;
  std::optional<std::string> name_;            // of the curve that is fitted
  bool remembers_ = false;                     // the muscle of this curve
  std::vector<estimation::Capture> captures_;  // at effective pressures, as a suspect corrects them
  io::SceneCalibration changes_;
  CalibrationOutcome outcome_;
};

}  // namespace

std::vector<double> tipErrors(const io::Scene& scene,
                              const std::vector<estimation::Capture>& captures) {
  std::vector<double> errors(captures.size(), std::nan(""));
  if (!scene.tags) return errors;
  const std::vector<FittedShape> shapes = fitShapes(scene, captures);
  for (std::size_t i = 0; i < captures.size(); ++i) {
    const statics::Solution& model = shapes[i].model;
    const std::optional<estimation::TwistFit>& fit = shapes[i].fit;
    const bool fitted = fit && fit->status == estimation::FitStatus::kConverged;
    if (!fitted || !model.converged()) continue;
    const lie::SE3 tip = fit->X_B0B * model::tipPose(fit->shape);
    errors[i] = (tip.translation - model.tip.translation).norm();
  }
  return errors;
}

std::optional<double> medianTipError(const io::Scene& scene,
                                     const std::vector<estimation::Capture>& captures) {
  std::vector<double> errors = tipErrors(scene, captures);
  errors.erase(std::remove_if(errors.begin(), errors.end(), [](double e) { return std::isnan(e); }),
               errors.end());
  if (errors.empty()) return std::nullopt;
  return basics::medianOf(std::move(errors));
}

CalibrationOutcome runCalibration(const std::string& path,
                                  const std::vector<io::Override>& overrides,
                                  const CalibrationRequest& request, const CalibrationData& data,
                                  const std::vector<CompanionArm>& companions) {
  return CalibrationJob(path, overrides, request, data, companions).run();
}

std::string utcNow() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%SZ", &utc);
  return text.data();
}

io::Provenance provenanceOf(const std::string& path, const std::vector<io::Override>& overrides,
                            const std::string& sha256,
                            const std::vector<io::Provenance::Data>& data) {
  io::Provenance out;
  out.date = utcNow();
  out.package_version = HELIX_ARM_VERSION;
  out.from = path;
  out.from_sha256 = sha256;
  for (const io::Override& one : overrides) {
    out.overrides += (out.overrides.empty() ? "" : " ") + one.key + "=" + one.value;
  }
  out.data = data;
  return out;
}

std::vector<estimation::Suspect> tagSuspectsOf(const io::Scene& scene,
                                               const std::vector<estimation::Capture>& captures) {
  constexpr std::size_t kMost = 20;
  std::vector<estimation::Capture> some;
  for (std::size_t k = 0; k < std::min(kMost, captures.size()); ++k) {
    some.push_back(captures[k * captures.size() / std::min(kMost, captures.size())]);
    // Captures at one pressure would share their shape [Pa].
    const Eigen::VectorXd rest = Eigen::VectorXd::Zero(scene.arm.actuatorCount());
    some.back().pressure = scene.arm.clamped(rest).array() + static_cast<double>(k);
  }
  some.erase(std::remove_if(some.begin(), some.end(), isEmpty), some.end());
  estimation::CalibrationOptions options;
  options.fit = {FitParameter::kBase};
  options.free_shapes = true;
  options.corner_noise = scene.vision.fit.corner_noise;
  options.position_noise = scene.vision.fit.position_noise;
  options.rotation_noise = scene.vision.fit.rotation_noise;
  return estimation::suspectsOf({makeArmCaptures(scene, std::move(some))}, options);
}

}  // namespace helix_arm::procedures
