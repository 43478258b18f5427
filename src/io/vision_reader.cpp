#include "vision_reader.hpp"

#include <stdexcept>

#include "pose_reader.hpp"

namespace helix_arm::io {
namespace {

const NumberRule kDecimation{"a finite value >= 1", [](double x) { return x >= 1; }, 1, 16};
const NumberRule kBlur = within(kFinite, -10, 10, " px");
const NumberRule kCornerNoise = within(kPositive, 1e-3, 100, " px");
const NumberRule kSmallLength = within(kPositive, 1e-6, 1, " m");
const NumberRule kAngleNoise = within(kNotNegative, 0, 180, " degrees");
const NumberRule kSmallAngle = within(kPositive, 1e-4, 180, " degrees");
const NumberRule kRobustScale = within(kPositive, 0.1, 1e6);

vision::TrackingMode readTracking(const MapReader& keys, vision::TrackingMode fallback) {
  using vision::TrackingMode;
  if (!keys.has("tracking")) return fallback;
  const auto name = keys.choice("tracking", {"edges", "regions", "full"});
  if (name == "edges") return TrackingMode::kEdges;
  if (name == "regions") return TrackingMode::kRegions;
  return TrackingMode::kFull;
}

void readDetector(const MapReader& keys, vision::DetectorConfig& detector) {
  detector.quad_decimate = keys.number("quad_decimate", kDecimation, detector.quad_decimate);
  detector.quad_sigma = keys.number("quad_sigma_px", kBlur, detector.quad_sigma);
  detector.threads = static_cast<int>(keys.integer("threads", 1, 64, detector.threads));
  detector.refine_edges = keys.truth("refine_edges", detector.refine_edges);
  detector.max_hamming = static_cast<int>(keys.integer("max_hamming", 0, 3, detector.max_hamming));
}

void readFit(const MapReader& keys, const Value& value, estimation::TwistFitOptions& fit,
             FaultList& faults) {
  fit.corner_noise = keys.number("corner_noise_px", kCornerNoise, fit.corner_noise);
  fit.position_noise = keys.number("tag_position_noise_m", kSmallLength, fit.position_noise);
  if (const auto deg = keys.optionalNumber("tag_rotation_noise_deg", kAngleNoise)) {
    fit.rotation_noise = radians(*deg);
  }
  fit.robust_scale = keys.number("robust_scale", kRobustScale, fit.robust_scale);
  if (const Value* given = value.find("base_prior")) {
    const MapReader prior(*given, keys.path("base_prior"), {"translation_m", "rotation_deg"},
                          faults);
    fit.free_base = true;
    fit.base_prior.translation =
        prior.number("translation_m", kSmallLength, fit.base_prior.translation);
    if (const auto deg = prior.optionalNumber("rotation_deg", kSmallAngle)) {
      fit.base_prior.rotation = radians(*deg);
    }
  }
  if (const auto bleed = keys.optionalNumber("bleed_prior_m", kSmallLength)) {
    fit.free_bleed = true;
    fit.bleed_prior = *bleed;
  }
}

void readKeys(const MapReader& keys, const Value& value, vision::LocalizerConfig& config,
              FaultList& faults) {
  readDetector(keys, config.detector);
  config.tracking = readTracking(keys, config.tracking);
  config.min_tags =
      static_cast<int>(keys.integer("min_tags", 2, estimation::kMaxTags, config.min_tags));
  readFit(keys, value, config.fit, faults);
}

}  // namespace

vision::LocalizerConfig readVision(const MapReader& scene, const Value& document,
                                   const std::string& family, FaultList& faults) {
  vision::LocalizerConfig config;
  if (!family.empty()) config.detector.family = family;
  const std::size_t faults_before = faults.count();
  if (const Value* value = document.find("vision")) {
    readKeys(MapReader(*value, scene.path("vision"),
                       {"quad_decimate", "quad_sigma_px", "threads", "refine_edges", "max_hamming",
                        "tracking", "min_tags", "corner_noise_px", "tag_position_noise_m",
                        "tag_rotation_noise_deg", "robust_scale", "base_prior", "bleed_prior_m"},
                       faults),
             *value, config, faults);
  }
  if (faults.count() != faults_before) return config;
  try {
    config.detector.validate();
  } catch (const std::invalid_argument& error) {
    scene.complain("vision", std::string("does not configure a tag detector: ") + error.what());
  }
  return config;
}

}  // namespace helix_arm::io
