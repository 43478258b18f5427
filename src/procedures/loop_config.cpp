#include "loop_config.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>

#include "basics/text.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/calibration/calibration_parameters.hpp"
#include "helix_arm/localization/rig_memory.hpp"
#include "io/document/number.hpp"

namespace helix_arm::procedures {
namespace {

constexpr double kLeastDeviation = 1e-4;  // lower bound of calibrated deviations
// Upper bound of calibrated deviations: what is identifiable is not less certain, and exponentials
// of multiples of it are finite.
constexpr double kMostDeviation = 0.5;
constexpr double kSlowSmoothing = 1.0;  // [s]

// Largest relative standard error of the identifiable parameters with this name (also with a suffix
// _ACTUATOR); absent if there are none.
std::optional<double> relativeError(const io::Provenance& calibration, const std::string& name) {
  std::optional<double> out;
  for (const io::Provenance::Parameter& one : calibration.parameters) {
    const bool named = one.name == name || one.name.compare(0, name.size() + 1, name + "_") == 0;
    if (!named || !one.identifiable || one.value == 0) continue;
    const double error =
        std::clamp(one.standard_error / std::abs(one.value), kLeastDeviation, kMostDeviation);
    out = std::max(out.value_or(0.0), error);
  }
  return out;
}

// Replaces deviations and correlation by what the combinations of a calibration say.
void correlate(const io::Provenance& calibration, estimation::ArmFilterOptions& filter) {
  static constexpr const char* kNames[] = {"K_gamma", "K_kappa", "K_tau", "K_eps"};
  double* const deviations[] = {&filter.stiffness_deviation.gamma,
                                &filter.stiffness_deviation.kappa, &filter.stiffness_deviation.tau,
                                &filter.K_eps_deviation};
  Eigen::Matrix4d covariance = Eigen::Matrix4d::Zero();
  for (const io::Provenance::Combination& one : calibration.combinations) {
    Eigen::Vector4d powers = Eigen::Vector4d::Zero();
    for (int i = 0; i < 4; ++i) {
      const auto power = one.exponents.find(kNames[i]);
      if (power != one.exponents.end()) powers[i] = power->second;
    }
    // Bounds of the combination, not of its parameters: they would loosen what is known well.
    const double error = std::clamp(one.relative_error, kLeastDeviation, kMostDeviation);
    covariance += error * error * powers * powers.transpose();
  }
  for (int i = 0; i < 4; ++i) {
    if (!(covariance(i, i) > 0)) continue;
    *deviations[i] = std::sqrt(covariance(i, i));
    for (int j = 0; j < i; ++j) {
      if (!(covariance(j, j) > 0)) continue;
      const double correlation = covariance(i, j) / std::sqrt(covariance(i, i) * covariance(j, j));
      filter.stiffness_correlation(i, j) = filter.stiffness_correlation(j, i) = correlation;
    }
  }
}

void startFrom(const io::Provenance& calibration, estimation::ArmFilterOptions& filter) {
  const auto set = [&calibration](const char* name, double& deviation) {
    deviation = relativeError(calibration, name).value_or(deviation);
  };
  set("K_gamma", filter.stiffness_deviation.gamma);
  set("K_tau", filter.stiffness_deviation.tau);
  set("K_kappa", filter.stiffness_deviation.kappa);
  set("K_eps", filter.K_eps_deviation);
  set("length_scale", filter.length_deviation);
  set("stroke_scale", filter.stroke_deviation);
  correlate(calibration, filter);
}

using estimation::RigEstimate;

constexpr double kTypicalInput = 0.3;  // part of the limits

// A calibrated camera on its stand stays where it is to this.
constexpr estimation::BasePrior kSteady = {0.0002, 0.0003};

// Error of the camera's pose seen from the base that a calibration found.
std::optional<lie::Vector6> baseErrorOf(const io::Scene& scene) {
  // For tag poses, `base` is the place of the instrument that measured them.
  const char* const unit = scene.hasBodies() ? "m" : "px";
  if (!scene.calibration || scene.calibration->error_unit != unit) return std::nullopt;
  const auto known = scene.calibration->errorOf(estimation::FitParameter::kBase, "");
  return known ? std::optional<lie::Vector6>(known->deviations) : std::nullopt;
}

// The fit of the scene's tags while the camera is where a calibration found it.
estimation::TwistFitOptions fitOf(const io::Scene& scene) {
  estimation::TwistFitOptions out = scene.vision.fit;
  if (const auto error = baseErrorOf(scene)) {
    const auto calibrated = [](double steady, double found, double prior) {
      return std::min(std::max(steady, found), prior);
    };
    out.base_prior = {
        calibrated(kSteady.translation, error->head<3>().maxCoeff(), out.base_prior.translation),
        calibrated(kSteady.rotation, error->tail<3>().maxCoeff(), out.base_prior.rotation)};
  }
  return out;
}

// The scene's view, as the placements of its tags are known.
estimation::PlacedView nominalViewOf(const io::Scene& scene) {
  const estimation::TwistFitOptions fit = fitOf(scene);
  estimation::PlacedView out{scene.view(), fit, {*scene.tags, scene.tag_prior, fit.base_prior}};
  if (const auto error = baseErrorOf(scene)) out.deviations.base = *error;
  for (std::size_t i = 0; i < scene.tags->tags.size(); ++i) {
    const lie::Vector6& error = scene.tags->tags[i].error;
    if (!error.isZero(0)) out.deviations.tags[i] = error;
  }
  return out;
}

// Base and border shift by the placements at a typical shape, with the tags that face the camera.
RigEstimate::Matrix rigByPlacementsOf(const io::Scene& scene,
                                      const estimation::PlacedView& placed) {
  const Eigen::VectorXd pressure = scene.arm.inputAt(kTypicalInput);
  const model::Shape shape =
      statics::startingShape(scene.model, scene.model.solve(pressure), pressure);
  std::vector<int> tags;
  for (const estimation::TagImage& one : estimation::visibleTags(placed.view, shape)) {
    tags.push_back(one.tag);
  }
  return estimation::rigByPlacements(placed, scene.arm, shape, tags)
      .value_or(RigEstimate::Matrix::Zero());
}

}  // namespace

follow::VisualServoConfig loopConfigOf(const io::Scene& scene) {
  basics::require(
      !scene.safety.channels.empty(), "scene ", scene.name,
      " has actuators that are not driven by pressure; the closed loop needs pressures");
  follow::VisualServoConfig out = scene.follow;
  out.filter.planar = scene.vision.fit.planar;
  out.placed = placedViewOf(scene);
  if (scene.calibration) startFrom(*scene.calibration, out.filter);
  return out;
}

std::string loopWarning(const follow::VisualServoConfig& config) {
  if (config.smoothing <= kSlowSmoothing) return {};
  return "follow: the loop smooths over " +
         io::formatNumber(std::round(100 * config.smoothing) / 100) +
         " s, which is slow; stiffen or damp the arm, and give paths rather than distant targets";
}

std::optional<estimation::PlacedView> placedViewOf(const io::Scene& scene) {
  if (!scene.isSeen()) return std::nullopt;
  estimation::PlacedView out = nominalViewOf(scene);
  if (out.fit.free_base) {
    const auto errors =
        estimation::RigMemory::heldErrors(out.fit, rigByPlacementsOf(scene, out)).diagonal();
    out.deviations.base = errors.head<6>().cwiseSqrt();
  }
  out.fit = estimation::RigMemory::heldOptions(out.fit);
  return out;
}

std::vector<int> uncalibratedTags(const estimation::TagLayout& layout, const std::vector<int>& of) {
  std::vector<int> out;
  for (const int index : of) {
    const estimation::TagPlacement& tag = layout.tags.at(static_cast<std::size_t>(index));
    if (!tag.placed) out.push_back(tag.id);
  }
  return out;
}

std::string uncalibratedText(const std::vector<int>& ids) {
  if (ids.empty()) return {};
  std::vector<std::string> words;
  for (const int id : ids) words.push_back(std::to_string(id));
  return "no capture of the calibration shows the tags " + basics::joined(words) +
         ", which count little: calibrate again with captures that show them";
}

vision::LocalizerConfig localizerConfigOf(const io::Scene& scene) {
  vision::LocalizerConfig out = scene.vision;
  out.fit = fitOf(scene);
  out.frame_known = !scene.hasBodies() || scene.motion_capture.X_BF;
  if (scene.isSeen()) {
    out.rig_by_placements = rigByPlacementsOf(scene, nominalViewOf(scene));
  }
  return out;
}

}  // namespace helix_arm::procedures
