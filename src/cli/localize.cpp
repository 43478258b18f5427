#include <algorithm>
#include <iostream>

#include "basics/quote.hpp"
#include "basics/text.hpp"
#include "command.hpp"
#include "helix_arm/vision/arm_localizer.hpp"
#include "measurements.hpp"
#include "procedures/calibration_job.hpp"
#include "procedures/captures.hpp"
#include "vision/frame_source.hpp"

namespace helix_arm::cli {
namespace {

using vision::ObservationState;
using vision::TagDetection;

struct LocalizeOptions {
  std::string scene;
  InputArguments input;
  std::vector<std::string> pictures;
};

// Fitted parameters that are improbably far from their priors.
json suspicionsOf(const estimation::TwistFit& fit, const estimation::TwistFitOptions& options) {
  constexpr double kLikely = 3.0;  // standard deviations
  json suspicions = json::array();
  const auto judge = [&](const char* parameter, double deviations, const char* remedy) {
    if (deviations <= kLikely) return;
    suspicions.push_back(
        {{"parameter", parameter}, {"deviations", deviations}, {"remedy", remedy}});
  };
  if (options.free_base) {
    const lie::Vector6 offset = fit.X_B0B.log();
    judge("base",
          std::max(offset.head<3>().cwiseAbs().maxCoeff() / options.base_prior.translation,
                   offset.tail<3>().cwiseAbs().maxCoeff() / options.base_prior.rotation),
          "check camera.position_m and rpy_deg, arm.base, camera.focal_px and tags.size_m, or "
          "widen vision.base_prior");
  }
  if (options.free_border_shift) {
    judge("bleed_m", std::abs(fit.border_shift) / options.border_shift_prior,
          "check tags.size_m (`helix_arm tags` prints over which edge) and the exposure, or widen "
          "vision.bleed_prior_m");
  }
  return suspicions;
}

json tagsJson(const std::vector<TagDetection>& detections) {
  return listJson(detections, [](const TagDetection& tag) -> json {
    return {{"id", tag.id},
            {"corners_px", tag.corners.transpose()},
            {"hamming", tag.hamming},
            {"margin", tag.margin}};
  });
}

// A picture's entry of the report.
// @param reason  why there is no twist; empty if there is one.
json frameOf(const std::string& file, const std::string& state, const std::string& reason) {
  json frame{{"file", file}, {"state", state}, {"reason", textOrNull(reason)}};
  for (const char* key :
       {"tags", "unknown_tags", "repeated_tags", "unusable_tags", "outlier_tags", "suspicious"}) {
    frame[key] = json::array();
  }
  for (const char* key :
       {"twist", "covariance", "rms_px", "tip", "tip_covariance", "base", "bleed_m"}) {
    frame[key] = nullptr;
  }
  return frame;
}

// Tags or a twist were expected and not found.
bool isFailure(const json& frame) {
  const bool strangers = frame["unknown_tags"].size() >= frame["tags"].size();
  const bool measured = !frame["twist"].is_null() || frame["state"] == "tags_only";
  return !measured && (frame["tags"].empty() || !strangers);
}

// Finds tags, and the arm's shape if the scene has a camera.
class Locator {
 public:
  explicit Locator(const io::Scene& scene, model::Shape model)
      : scene_(scene), model_(std::move(model)) {}

  void reset() {
    if (localizer_) localizer_->reset();
  }

  json locate(const vision::Frame& frame) {
    const std::string reason = whyNoTwist(frame.gray.size());
    if (reason.empty()) return localize(frame);
    if (!detector_) detector_.emplace(scene_.vision.detector);
    json located = frameOf(frame.name, "tags_only", reason);
    located["tags"] = tagsJson(detector_->detect(frame.gray));
    return withTags(located);
  }

  /// The usual mistakes that explain why tags do not fit; none if they do.
  std::vector<estimation::Suspect> suspects() const {
    if (!odd_) return {};
    const procedures::LoadedCaptures seen = procedures::makeCaptures(scene_, seen_, "the pictures");
    return procedures::tagSuspectsOf(scene_, seen.captures);
  }

  // Result of a frame that could not be read.
  json broken(const vision::Frame& frame) const {
    return frame.wrong_size ? frameOf(frame.name, "wrong_size", whyNoTwist(*frame.wrong_size))
                            : frameOf(frame.name, "unreadable", frame.fault);
  }

  // Size that its pictures must have; any size if they are not measured.
  std::optional<cv::Size> expectedSize() const {
    if (!scene_.tags || !scene_.camera) return std::nullopt;
    return cv::Size(scene_.camera->model.width, scene_.camera->model.height);
  }

 private:
  std::string whyNoTwist(const cv::Size& size) const {
    if (!scene_.tags) return "scene " + scene_.name + " has no tags";
    if (!scene_.camera) return "scene " + scene_.name + " has no camera";
    const estimation::Camera& camera = scene_.camera->model;
    if (size == cv::Size(camera.width, camera.height)) return "";
    return basics::format("the picture has %d x %d pixels, the camera of scene ", size.width,
                          size.height) +
           scene_.name +
           basics::format(" %d x %d; take pictures of that size, or calibrate the camera at theirs",
                          camera.width, camera.height);
  }

  // As it is, or without any tag that says so.
  json withTags(json located) const {
    if (!located["tags"].empty()) return located;
    return frameOf(located["file"], nameOf(ObservationState::kNoTags),
                   "no tag of family " + scene_.vision.detector.family + " is in sight");
  }

  // The corners that were seen, for suspects: of a long video, those of evenly spaced pictures.
  void keep(const std::vector<TagDetection>& detections) {
    constexpr std::size_t kMost = 64;
    if (seen_.size() == kMost) {
      for (std::size_t k = 0; k < kMost / 2; ++k) seen_[k] = std::move(seen_[2 * k + 1]);
      seen_.resize(kMost / 2);
      spacing_ *= 2;
    }
    if (++pictures_ % spacing_ != 0) return;
    io::TagCornerCapture seen{pictures_, Eigen::VectorXd::Zero(scene_.arm.actuatorCount()), {}};
    for (const TagDetection& tag : detections) seen.tags.push_back({tag.id, tag.corners});
    seen_.push_back(std::move(seen));
  }

  json localize(const vision::Frame& frame) {
    if (!localizer_) localizer_.emplace(scene_.view(), scene_.vision);
    const vision::Observation& seen = localizer_->locate(frame.gray, model_);
    const bool measured = seen.state == ObservationState::kMeasured;
    json located = frameOf(frame.name, nameOf(seen.state), measured ? "" : reasonOf(seen));
    located["tags"] = tagsJson(seen.detections);
    located["unknown_tags"] = seen.unknown_ids;
    located["repeated_tags"] = seen.repeated_ids;
    located["unusable_tags"] = seen.unusable_ids;
    keep(seen.detections);
    odd_ |= seen.state == ObservationState::kNoFit;
    if (!measured) return withTags(located);
    const estimation::TwistFit& fit = seen.fit;
    const estimation::TwistFitOptions& options = scene_.vision.fit;
    located["suspicious"] = suspicionsOf(fit, options);
    odd_ |= fit.outliers() > 0 || fit.rms > kFar * options.corner_noise ||
            !located["suspicious"].empty();
    for (const estimation::TagResidual& tag : fit.tags) {
      if (tag.outlier) located["outlier_tags"].push_back(scene_.tags->tags[tag.tag].id);
    }
    located["twist"] = fit.twists.transpose();
    located["covariance"] = fit.covariance;
    located["rms_px"] = fit.rms;
    located["tip"] = measuredTip(fit);
    located["tip_covariance"] = fit.tip_covariance;
    if (options.free_base) located["base"] = fit.X_B0B;
    if (options.free_border_shift) located["bleed_m"] = fit.border_shift;
    return located;
  }

  std::string reasonOf(const vision::Observation& observation) const {
    if (observation.state == ObservationState::kNoFit)
      return "no shape of the arm fits the tags in sight";
    std::vector<int> used;
    for (const TagDetection& tag : observation.detections) {
      const int index = scene_.tags->find(tag.id);
      const bool usable =
          !isOneOf(tag.id, observation.repeated_ids) && !isOneOf(tag.id, observation.unusable_ids);
      if (index >= 0 && usable) used.push_back(index);
    }
    if (observation.state == ObservationState::kNoTags) {
      if (!observation.repeated_ids.empty())
        return "each visible tag of the scene appears more than once";
      if (!observation.unusable_ids.empty())
        return "the visible tags of the scene are where the lens distortion cannot be inverted";
      return "no tag of the scene is in sight";
    }
    if (static_cast<int>(used.size()) < scene_.vision.min_tags) {
      return std::to_string(used.size()) + " of the scene's tags in sight; vision.min_tags is " +
             std::to_string(scene_.vision.min_tags);
    }
    return whyUndetermined(scene_, used, 2);
  }

  static bool isOneOf(int id, const std::vector<int>& ids) {
    return std::find(ids.begin(), ids.end(), id) != ids.end();
  }

  const io::Scene& scene_;
  model::Shape model_;
  // A picture whose tags are further off, in expected deviations, has suspects.
  static constexpr double kFar = 3.0;
  std::vector<io::TagCornerCapture> seen_;
  int pictures_ = 0, spacing_ = 1;
  bool odd_ = false;  // a picture whose tags do not fit
  std::optional<vision::ArmLocalizer> localizer_;
  std::optional<vision::TagDetector> detector_;
};

json locateAll(const std::vector<std::string>& paths, Locator& locator) {
  std::vector<std::unique_ptr<vision::FrameSource>> sources;
  for (const std::string& path : paths)
    sources.push_back(vision::FrameSource::files(path, locator.expectedSize()));
  json located = json::array();
  vision::Frame frame;
  for (const auto& source : sources) {
    locator.reset();
    for (vision::FrameStatus status; (status = source->next(frame)) != vision::FrameStatus::kEnd;) {
      if (!source->continuous()) locator.reset();
      const bool sound = status == vision::FrameStatus::kFrame;
      located.push_back(sound ? locator.locate(frame) : locator.broken(frame));
    }
  }
  return located;
}

// One row per tag; a frame without tags has one row, and missing values are empty cells.
void printTags(const io::Scene& scene, const json& frames, std::ostream& out) {
  const estimation::TwistFitOptions& options = scene.vision.fit;
  std::vector<std::string> corners;
  for (const char* corner : {"corner_1", "corner_2", "corner_3", "corner_4"}) {
    for (const char* axis : {"_x_px", "_y_px"}) corners.push_back(std::string(corner) + axis);
  }
  Columns columns{"file", "state", "tag"};
  columns.insert(columns.end(), corners.begin(), corners.end());
  columns.push_back("rms_px");
  if (options.free_base) columns.push_back("base");
  if (options.free_border_shift) columns.push_back("bleed_m");
  columns.push_back("twist");
  CsvTable table(out, columns, &scene.arm);
  for (json row : frames) {
    row["file"] = basics::printable(row["file"].get<std::string>());
    for (const std::string& corner : corners) row[corner] = nullptr;
    row["tag"] = nullptr;
    if (row["tags"].empty()) table.add(row);
    for (const json& tag : row["tags"]) {
      row["tag"] = tag["id"];
      for (std::size_t k = 0; k < corners.size(); ++k) {
        row[corners[k]] = tag["corners_px"][k / 2][k % 2];
      }
      table.add(row);
    }
  }
}

int run(const LocalizeOptions& options, const GlobalOptions& global) {
  const io::Scene scene = loadScene(options.scene, global);
  const Eigen::VectorXd inputs = inputsOrRest(scene, options.input);
  const statics::Solution start = scene.model.solve(inputs);
  Locator locator(scene, statics::startingShape(scene.model, start, inputs));
  const json frames = locateAll(options.pictures, locator);
  const std::string note = noteOnStart(start);
  if (!note.empty()) std::cerr << note << "\n";
  const std::vector<estimation::Suspect> suspects = locator.suspects();
  const json report{{"scene", scene.name},
                    {"model_status", nameOf(start.status)},
                    {"frames", frames},
                    {"suspects", suspects}};
  json shown = without(report, {"model_status", "suspects"});
  for (const std::string& text : procedures::textsOf(suspects)) shown["notes"].push_back(text);
  for (json& frame : shown["frames"]) {
    for (json& tag : frame["tags"]) tag = json(tag["id"]);
  }
  printResult(global.format, report, shown,
              [&](std::ostream& out) { printTags(scene, frames, out); });
  return std::any_of(frames.begin(), frames.end(), isFailure) ? kNotPossible : kDone;
}

}  // namespace

void addLocalize(Commands& commands) {
  auto [command, options] = commands.add<LocalizeOptions>(
      "localize", "find tags in pictures, and the twist of the arm from them", run);
  addScene(command, options.scene);
  addOption(command, "IMAGE|VIDEO", options.pictures,
            "pictures, folders of pictures, or videos; the pictures of a video follow one another, "
            "all others are independent",
            kRequired);
  addInputOptions(
      command, options.input,
      "start of the search for the shape, gauge pressures [kPa], one per actuator: a,b,c; "
      "default: at rest",
      "start of the search in SI units instead of kPa: pressures [Pa], spool angles [rad]");
  command.footer(
      R"(Pixels: (0, 0) is the centre of the top-left one. Corners: bottom left, bottom right,
top right, top left as one reads the tag. Every tag of the scene's family is listed,
whether the scene has it or not.
json: scene, model_status (unless converged, the search began at the shape without
load), frames [{file, state, reason, tags [{id, corners_px, hamming, margin}],
unknown_tags, repeated_tags, unusable_tags, outlier_tags, twist (sections x 6),
covariance, rms_px, tip, tip_covariance (of its position), base and bleed_m (null unless
fitted), suspicious [{parameter, deviations, remedy}] (more than 3 standard deviations
from its prior)}], suspects [{cause, where, explains, remedy}] (usual mistakes of tags or
pictures that explain why tags do not fit, best first).
state: measured, no_tags, too_few_tags, no_fit, tags_only (the scene has no camera or no
tags), wrong_size (not the camera's size; not searched) or unreadable.
csv: one row per tag.
Exit code 1 if a picture cannot be read, does not have the camera's size, holds no tags,
or holds tags of the scene that give no twist.)");
}

}  // namespace helix_arm::cli
