#include <algorithm>
#include <cmath>
#include <iomanip>
#include <iostream>
#include <memory>
#include <optional>
#include <sstream>

#include "arguments.hpp"
#include "command.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/vision/arm_localizer.hpp"
#include "helix_arm/vision/frame_source.hpp"
#include "measurements.hpp"
#include "output.hpp"

namespace helix_arm::cli {
namespace {

using nlohmann::json;
using vision::ObservationState;
using vision::TagDetection;

struct LocalizeOptions {
  std::string scene, pressure_kpa, input;
  std::vector<std::string> pictures;
};

// A fitted parameter that is improbably far from its prior.
struct Suspicion {
  std::string parameter;
  double deviations;  // standard deviations of its prior
  std::string remedy;
};

// Result of one picture.
struct LocatedFrame {
  std::string file;
  std::string state;   // that of the observation, or "tags_only", "wrong_size" or "unreadable"
  std::string reason;  // why there is no twist; empty if there is one
  std::vector<TagDetection> tags;
  std::vector<int> unknown_tags, repeated_tags, unusable_tags, outlier_tags;
  std::optional<estimation::TwistFit> fit;
  std::vector<Suspicion> suspicious;
  bool failed = false;  // tags or a twist were expected and not found
};

std::vector<Suspicion> suspicionsOf(const estimation::TwistFit& fit,
                                    const estimation::TwistFitOptions& options) {
  constexpr double kLikely = 3.0;  // standard deviations
  std::vector<Suspicion> suspicions;
  if (options.free_base) {
    const lie::Vector6 offset = fit.X_B0B.log();
    const double deviations =
        std::max(offset.head<3>().cwiseAbs().maxCoeff() / options.base_prior.translation,
                 offset.tail<3>().cwiseAbs().maxCoeff() / options.base_prior.rotation);
    if (deviations > kLikely) {
      suspicions.push_back({"base", deviations,
                            "check camera.position_m and rpy_deg, arm.base, camera.focal_px and "
                            "tags.size_m, or widen vision.base_prior"});
    }
  }
  if (options.free_bleed) {
    const double deviations = std::abs(fit.bleed) / options.bleed_prior;
    if (deviations > kLikely) {
      suspicions.push_back({"bleed_m", deviations,
                            "check tags.size_m (the black border's outer edge) and the exposure, "
                            "or widen vision.bleed_prior_m"});
    }
  }
  return suspicions;
}

// Finds tags, and the arm's shape if the scene has a camera.
class Locator {
 public:
  explicit Locator(const io::Scene& scene, model::Shape model)
      : scene_(scene), model_(std::move(model)) {}

  void reset() {
    if (localizer_) localizer_->reset();
  }

  LocatedFrame locate(const vision::Frame& frame) {
    LocatedFrame located;
    located.file = frame.name;
    located.reason = whyNoTwist(frame.gray.size());
    if (located.reason.empty()) {
      localize(frame.gray, located);
    } else {
      if (!detector_) detector_.emplace(scene_.vision.detector);
      located.state = "tags_only";
      located.tags = detector_->detect(frame.gray);
    }
    if (located.tags.empty()) {
      located.failed = true;
      located.state = nameOf(ObservationState::kNoTags);
      located.reason = "no tag of family " + scene_.vision.detector.family + " is in sight";
    }
    return located;
  }

  // Result of a frame that could not be read.
  LocatedFrame broken(const vision::Frame& frame) const {
    LocatedFrame located;
    located.file = frame.name;
    located.state = frame.wrong_size ? "wrong_size" : "unreadable";
    located.reason = frame.wrong_size ? whyNoTwist(*frame.wrong_size) : frame.fault;
    located.failed = true;
    return located;
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
    std::ostringstream text;
    text << "the picture has " << size.width << " x " << size.height
         << " pixels, the camera of scene " << scene_.name << " " << camera.width << " x "
         << camera.height << "; take pictures of that size, or calibrate the camera at theirs";
    return text.str();
  }

  void localize(const cv::Mat& gray, LocatedFrame& located) {
    if (!localizer_) localizer_.emplace(scene_.view(), scene_.vision);
    const vision::Observation& observation = localizer_->locate(gray, model_);
    located.state = nameOf(observation.state);
    located.tags = observation.detections;
    located.unknown_tags = observation.unknown_ids;
    located.repeated_tags = observation.repeated_ids;
    located.unusable_tags = observation.unusable_ids;
    if (observation.state == ObservationState::kMeasured) {
      located.fit = observation.fit;
      located.suspicious = suspicionsOf(observation.fit, scene_.vision.fit);
      for (const estimation::TagResidual& tag : observation.fit.tags) {
        if (tag.outlier) located.outlier_tags.push_back(scene_.tags->tags[tag.tag].id);
      }
      return;
    }
    located.reason = reasonOf(observation);
    located.failed = observation.unknown_ids.size() < observation.detections.size();
  }

  std::string reasonOf(const vision::Observation& observation) const {
    if (observation.state == ObservationState::kNoFit)
      return "no shape of the arm fits the tags in sight";
    std::vector<int> used;
    for (const TagDetection& tag : observation.detections) {
      const int index = scene_.tags->find(tag.id);
      if (index < 0 || isOneOf(tag.id, observation.repeated_ids) ||
          isOneOf(tag.id, observation.unusable_ids)) {
        continue;
      }
      used.push_back(index);
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
  std::optional<vision::ArmLocalizer> localizer_;
  std::optional<vision::TagDetector> detector_;
};

std::vector<LocatedFrame> locateAll(const std::vector<std::string>& paths, Locator& locator) {
  std::vector<std::unique_ptr<vision::FrameSource>> sources;
  for (const std::string& path : paths)
    sources.push_back(vision::FrameSource::files(path, locator.expectedSize()));
  std::vector<LocatedFrame> located;
  vision::Frame frame;
  for (const auto& source : sources) {
    locator.reset();
    for (;;) {
      const vision::FrameStatus status = source->next(frame);
      if (status == vision::FrameStatus::kEnd) break;
      if (!source->continuous()) locator.reset();
      if (status == vision::FrameStatus::kFrame) {
        located.push_back(locator.locate(frame));
      } else {
        located.push_back(locator.broken(frame));
      }
    }
  }
  return located;
}

json frameJson(const LocatedFrame& frame, const estimation::TwistFitOptions& options) {
  json tags = json::array();
  for (const TagDetection& tag : frame.tags) {
    json corners = json::array();
    for (int k = 0; k < 4; ++k) corners.push_back(toJson(tag.corners.col(k)));
    tags.push_back({{"id", tag.id},
                    {"corners_px", corners},
                    {"hamming", tag.hamming},
                    {"margin", tag.margin}});
  }
  json result{{"file", frame.file},
              {"state", frame.state},
              {"reason", textOrNull(frame.reason)},
              {"tags", tags},
              {"unknown_tags", frame.unknown_tags},
              {"repeated_tags", frame.repeated_tags},
              {"unusable_tags", frame.unusable_tags},
              {"outlier_tags", frame.outlier_tags},
              {"twist", nullptr},
              {"covariance", nullptr},
              {"rms_px", nullptr},
              {"tip", nullptr},
              {"tip_covariance", nullptr},
              {"base", nullptr},
              {"bleed_m", nullptr},
              {"suspicious", json::array()}};
  for (const Suspicion& suspicion : frame.suspicious) {
    result["suspicious"].push_back({{"parameter", suspicion.parameter},
                                    {"deviations", suspicion.deviations},
                                    {"remedy", suspicion.remedy}});
  }
  if (frame.fit) {
    result["twist"] = toJson(frame.fit->twists);
    result["covariance"] = rowsJson(frame.fit->covariance);
    result["rms_px"] = frame.fit->rms;
    result["tip"] = toJson(measuredTip(*frame.fit));
    result["tip_covariance"] = rowsJson(frame.fit->tip_covariance);
    if (options.free_base) result["base"] = toJson(frame.fit->X_B0B);
    if (options.free_bleed) result["bleed_m"] = frame.fit->bleed;
  }
  return result;
}

json reportOf(const io::Scene& scene, const statics::Solution& start,
              const std::vector<LocatedFrame>& frames) {
  json list = json::array();
  for (const LocatedFrame& frame : frames) list.push_back(frameJson(frame, scene.vision.fit));
  return {{"scene", scene.name}, {"model_status", nameOf(start.status)}, {"frames", list}};
}

// Quoted where needed, since paths may contain commas.
std::string fileCell(const std::string& text) {
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  return quotedCell(text);
}

// One row per tag; a frame without tags has one row, and missing values are empty cells.
CsvTable csvTable(const io::Scene& scene, const std::vector<LocatedFrame>& frames) {
  CsvTable table;
  for (const LocatedFrame& frame : frames) {
    CsvTable::Row fitted;
    const estimation::TwistFit fit = frame.fit.value_or(estimation::TwistFit());
    fitted.emplace_back("rms_px", exact(fit.rms));
    if (scene.vision.fit.free_base) appendPose("base_", fit.X_B0B, fitted);
    if (scene.vision.fit.free_bleed) fitted.emplace_back("bleed_m", exact(fit.bleed));
    appendTwists(frame.fit ? fit.twists : model::Twists::Zero(6, scene.arm.sectionCount()), fitted);
    if (!frame.fit) {
      for (auto& cell : fitted) cell.second.clear();
    }
    for (std::size_t i = 0; i < std::max<std::size_t>(frame.tags.size(), 1); ++i) {
      const TagDetection* tag = frame.tags.empty() ? nullptr : &frame.tags[i];
      CsvTable::Row row{{"file", fileCell(basics::printable(frame.file))},
                        {"state", frame.state},
                        {"tag", tag ? std::to_string(tag->id) : ""}};
      for (int k = 0; k < 4; ++k) {
        const std::string corner = "corner_" + std::to_string(k + 1);
        row.emplace_back(corner + "_x_px", tag ? exact(tag->corners(0, k)) : "");
        row.emplace_back(corner + "_y_px", tag ? exact(tag->corners(1, k)) : "");
      }
      row.insert(row.end(), fitted.begin(), fitted.end());
      table.add(row);
    }
  }
  return table;
}

int run(const LocalizeOptions& options, const GlobalOptions& global) {
  const io::Scene scene = loadScene(options.scene, global);
  const Eigen::VectorXd inputs = inputsOrRest(scene, options.pressure_kpa, options.input);
  const statics::Solution start = scene.model.solve(inputs);
  Locator locator(scene, statics::startingShape(scene.model, start, inputs));
  const std::vector<LocatedFrame> frames = locateAll(options.pictures, locator);
  const std::string note = noteOnStart(start);
  if (!note.empty()) std::cerr << note << "\n";
  const json report = reportOf(scene, start, frames);
  json shown = without(report, {"model_status"});
  for (json& frame : shown["frames"]) {
    for (json& tag : frame["tags"]) tag = json(tag["id"]);
  }
  printResult(
      global.format, report, [&] { return csvTable(scene, frames); }, shown);
  const bool failed = std::any_of(frames.begin(), frames.end(),
                                  [](const LocatedFrame& frame) { return frame.failed; });
  return failed ? kNotPossible : kDone;
}

}  // namespace

Subcommand addLocalize(CLI::App& app) {
  CLI::App* command =
      app.add_subcommand("localize", "find tags in pictures, and the twist of the arm from them");
  const auto options = std::make_shared<LocalizeOptions>();
  addScene(*command, "SCENE", options->scene, "scene file")->required();
  addOption(*command, "IMAGE|VIDEO", options->pictures,
            "pictures, folders of pictures, or videos; the pictures of a video follow one another, "
            "all others are independent",
            kRequired);
  addOption(*command, "--pressure-kpa", options->pressure_kpa,
            "start of the search for the shape, gauge pressures [kPa], one per actuator: a,b,c; "
            "default: at rest");
  addOption(*command, "--input", options->input,
            "start of the search in SI units instead of kPa: pressures [Pa], spool angles [rad]");
  command->footer(
      R"(Pixels: (0, 0) is the centre of the top-left one. Corners: bottom left, bottom right,
top right, top left as one reads the tag. Every tag of the scene's family is listed,
whether the scene has it or not.
json: scene, model_status (unless converged, the search began at the shape without
load), frames [{file, state, reason, tags [{id, corners_px, hamming, margin}],
unknown_tags, repeated_tags, unusable_tags, outlier_tags, twist (sections x 6),
covariance, rms_px, tip, tip_covariance (of its position), base and bleed_m (null unless
fitted), suspicious [{parameter, deviations, remedy}] (more than 3 standard deviations
from its prior)}].
state: measured, no_tags, too_few_tags, no_fit, tags_only (the scene has no camera or no
tags), wrong_size (not the camera's size; not searched) or unreadable.
csv: one row per tag.
Exit code 1 if a picture cannot be read, does not have the camera's size, holds no tags,
or holds tags of the scene that give no twist.)");
  return {command, [options](const GlobalOptions& global) { return run(*options, global); }};
}

}  // namespace helix_arm::cli
