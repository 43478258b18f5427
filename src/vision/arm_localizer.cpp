#include "helix_arm/vision/arm_localizer.hpp"

#include <algorithm>

#include "helix_arm/basics/requirement.hpp"
#include "tag_tracker.hpp"

namespace helix_arm::vision {
namespace {

// Cosine between a tag's normal and its line of sight; at larger angles detection is unreliable.
constexpr double kLeastCosine = 0.3;

bool contains(const std::vector<int>& ids, int id) {
  return std::find(ids.begin(), ids.end(), id) != ids.end();
}

}  // namespace

struct ArmLocalizer::Workspace {
  estimation::ArmView view;
  LocalizerConfig config;
  std::optional<TagTracker> tracker;  // absent with bodies
  estimation::TwistFitter fitter;
  std::optional<estimation::RigMemory> memory;
  std::optional<estimation::BaseWatch> base;
  Observation observation;

  bool warm = false;                      // the last picture was measured
  model::Twists last_twists, last_model;  // mean
  lie::SE3 last_X_B0B;
  std::vector<int> last_ids, last_outliers;
  std::vector<int> copied_ids;  // seen more than once when the whole picture was last searched

  estimation::ArmView expected_view;  // with the last fitted base
  std::vector<ExpectedTag> expected;
  std::vector<estimation::CornerObservation> seen;
  std::optional<estimation::BodyCheck> bodies;
  std::vector<estimation::PoseObservation> poses;

  Workspace(const estimation::ArmView& arm_view, const LocalizerConfig& localizer_config)
      : view(arm_view),
        config(localizer_config),
        fitter(view.layout, view.sections, config.fit),
        expected_view(view) {
    if (view.layout.hasBodies()) {
      bodies.emplace(view);
    } else {
      tracker.emplace(config.detector, config.tracking);
    }
    if (!config.rig_by_placements) return;
    memory.emplace(config.fit, *config.rig_by_placements);
    base.emplace(view.layout, view.sections, config.fit, *config.rig_by_placements);
  }

  // The last shape, moved as the model moved.
  model::Shape expectedShape(const model::Shape& model) const {
    return warm ? model.about(last_twists + (model.twists() - last_model)) : model;
  }

  // Image positions of the tags of that shape.
  model::Shape expectTags(const model::Shape& model) {
    expected.clear();
    const model::Shape shape = expectedShape(model);
    if (!warm) return shape;
    expected_view.X_CB = view.X_CB * last_X_B0B;
    for (const estimation::TagImage& tag :
         estimation::visibleTags(expected_view, shape, kLeastCosine)) {
      const int id = view.layout.tags[tag.tag].id;
      expected.push_back({id, tag.corners, contains(last_ids, id)});
    }
    return shape;
  }

  void take(const TrackResult& found) {
    observation.detections = found.tags;
    observation.by_edges = found.by_edges;
    observation.by_regions = found.by_regions;
    observation.whole_picture = found.whole_picture;
    observation.unknown_ids.clear();
    observation.repeated_ids.clear();
    observation.unusable_ids.clear();
    seen.clear();
    const std::vector<TagDetection>& tags = observation.detections;
    for (std::size_t i = 0; i < tags.size(); ++i) {
      const int id = tags[i].id;
      if (i > 0 && tags[i - 1].id == id) continue;
      const int tag = view.layout.find(id);
      // The edge search only follows the expected one, which may be either of the copies.
      const bool repeated = (i + 1 < tags.size() && tags[i + 1].id == id) ||
                            (!found.whole_picture && contains(copied_ids, id));
      if (tag < 0) {
        observation.unknown_ids.push_back(id);
      } else if (repeated) {
        observation.repeated_ids.push_back(id);
      } else if (const auto directions = estimation::directionsOf(view.camera, tags[i].corners)) {
        seen.push_back({tag, *directions});
      } else {
        observation.unusable_ids.push_back(id);
      }
    }
    if (found.whole_picture) copied_ids = observation.repeated_ids;
  }

  using Corners = std::vector<estimation::CornerObservation>;
  using Poses = std::vector<estimation::PoseObservation>;
  const estimation::TwistFit& fitFrom(const model::Shape& start, const model::Shape& model,
                                      const Corners& of) {
    return fitter.fit(of, view.X_CB, view.camera.focal(), start, model);
  }
  const estimation::TwistFit& fitFrom(const model::Shape& start, const model::Shape& model,
                                      const Poses& of) {
    return fitter.fit(of, start, model);
  }
  const estimation::TwistFit& fitCold(const model::Shape& model, const Corners& of) {
    return fitter.fitCold(of, view.X_CB, view.camera.focal(), model);
  }
  const estimation::TwistFit& fitCold(const model::Shape& model, const Poses& of) {
    return fitter.fitCold(of, model);
  }

  // Fits from the last shape and, if that does not explain the tags, from other starts.
  template <class Observations>
  void fit(const model::Shape& start, const model::Shape& model, const Observations& of) {
    observation.fit.status = estimation::FitStatus::kUnderdetermined;
    observation.state = of.empty() ? ObservationState::kNoTags : ObservationState::kTooFewTags;
    if (static_cast<int>(of.size()) < config.min_tags) return;
    if (memory) fitter.know(memory->estimate());
    const estimation::TwistFit* fit = &fitFrom(start, model, of);
    if (fit->status != estimation::FitStatus::kConverged || unexpectedOutliers(*fit)) {
      fit = &fitCold(model, of);
    }
    observation.fit = *fit;
    if (fit->status == estimation::FitStatus::kUnderdetermined) return;  // too few tags
    const bool is_measured = fit->status == estimation::FitStatus::kConverged &&
                             static_cast<int>(of.size()) - fit->outliers() >= config.min_tags;
    observation.state = is_measured ? ObservationState::kMeasured : ObservationState::kNoFit;
  }

  // A tag that came off the arm stays an outlier; only new outliers make the fit doubtful.
  bool unexpectedOutliers(const estimation::TwistFit& fit) const {
    return std::any_of(fit.tags.begin(), fit.tags.end(), [this](const auto& tag) {
      return tag.outlier && !contains(last_outliers, view.layout.tags[tag.tag].id);
    });
  }

  // @param see  arguments of BaseWatch::see(), after what was observed.
  template <class Observations, class... See>
  const Observation& conclude(const model::Shape& model, const Observations& of,
                              const See&... see) {
    const bool enough = static_cast<int>(of.size()) >= config.min_tags;
    if (base && enough) {
      base->see(of, see...);
      observation.moved = base->move();
    }
    warm = observation.state == ObservationState::kMeasured;
    if (memory && enough) memory->learn(observation.fit);
    last_ids.clear();
    last_outliers.clear();
    if (!warm) return observation;
    last_twists = observation.fit.twists;
    last_X_B0B = observation.fit.X_B0B;
    last_model = model.twists();
    for (const TagDetection& tag : observation.detections) last_ids.push_back(tag.id);
    for (const estimation::TagResidual& tag : observation.fit.tags) {
      if (tag.outlier) last_outliers.push_back(view.layout.tags[tag.tag].id);
    }
    return observation;
  }

  const Observation& locate(const cv::Mat& gray, const model::Shape& model) {
    const estimation::Camera& camera = view.camera;
    basics::require(gray.cols == camera.width && gray.rows == camera.height, "a picture of ",
                    gray.cols, " x ", gray.rows, " pixels; expected the camera's ", camera.width,
                    " x ", camera.height);
    const model::Shape start = expectTags(model);
    take(tracker->track(gray, expected));
    fit(start, model, seen);
    const bool doubtful =
        observation.state != ObservationState::kMeasured || unexpectedOutliers(observation.fit);
    if (doubtful && !observation.whole_picture) {
      take(tracker->search(gray));
      fit(start, model, seen);
    }
    return conclude(model, seen, view.X_CB, camera.focal(), start, model);
  }

  void take(const std::vector<estimation::BodyPose>& all, std::vector<estimation::BodyPose> sound) {
    observation.detections.clear();
    observation.unusable_ids.clear();
    observation.poses = all;
    poses.clear();
    const lie::SE3 X_BC = view.X_CB.inverse();
    for (const estimation::BodyPose& one : sound) poses.push_back({one.body, X_BC * one.X_CM});
    for (const estimation::BodyPose& one : all) {
      observation.detections.push_back({});
      observation.detections.back().id = one.body;
      const bool used = std::any_of(sound.begin(), sound.end(),
                                    [&one](const auto& other) { return other.body == one.body; });
      if (!used) observation.unusable_ids.push_back(one.body);
    }
  }

  const Observation& locate(std::vector<estimation::BodyPose> all, const model::Shape& model) {
    std::sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.body < b.body; });
    if (!config.frame_known) {
      take(all, {});
      observation.state = ObservationState::kNoFit;
      observation.fault =
          "the frame of the poses is not known: record captures and calibrate with --fit base, or "
          "give motion_capture.frame";
      return observation;
    }
    const model::Shape start = expectedShape(model);
    estimation::BodyCheck::Verdict verdict = bodies->check(all, start, model, warm);
    observation.fault = std::move(verdict.fault);
    take(all, verdict.sound);
    if (verdict.all) {  // what is known of the arm stays
      observation.state = ObservationState::kNoFit;
      return observation;
    }
    fit(start, model, poses);
    return conclude(model, poses, start, model);
  }
};

ArmLocalizer::ArmLocalizer(const estimation::ArmView& view, const LocalizerConfig& config)
    : work_(std::make_unique<Workspace>(view, config)) {}
ArmLocalizer::~ArmLocalizer() = default;
ArmLocalizer::ArmLocalizer(ArmLocalizer&&) noexcept = default;
ArmLocalizer& ArmLocalizer::operator=(ArmLocalizer&&) noexcept = default;

const Observation& ArmLocalizer::locate(const cv::Mat& gray, const model::Shape& model) {
  return work_->locate(gray, model);
}

const Observation& ArmLocalizer::locate(const std::vector<estimation::BodyPose>& seen,
                                        const model::Shape& model) {
  basics::require(work_->bodies.has_value(), "poses of bodies for a camera; expected a picture");
  return work_->locate(seen, model);
}

void ArmLocalizer::reset() {
  if (work_->bodies) work_->bodies->reset();
  work_->warm = false;
  work_->last_ids.clear();
  work_->last_outliers.clear();
  work_->copied_ids.clear();
}

void ArmLocalizer::forget() {
  reset();
  if (work_->memory) work_->memory->reset();
  if (work_->base) work_->base->reset();
}

const estimation::ArmView& ArmLocalizer::view() const { return work_->view; }

const char* nameOf(ObservationState state) {
  constexpr const char* kNames[] = {"measured", "no_tags", "too_few_tags", "no_fit"};
  return kNames[static_cast<std::size_t>(state)];
}

}  // namespace helix_arm::vision
