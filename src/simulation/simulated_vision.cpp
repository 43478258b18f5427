#include "simulated_vision.hpp"

#include <algorithm>
#include <random>

#include <opencv2/imgproc.hpp>

#include "basics/text.hpp"
#include "bodies.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/localization/rig_memory.hpp"
#include "helix_arm/model/curve.hpp"
#include "vision/frame_source.hpp"
#include "vision/jpeg.hpp"

namespace helix_arm::simulation {
namespace {

std::optional<MeasuredShape> measured(const estimation::TwistFit& fit) {
  MeasuredShape out{fit.twists, fit.covariance, model::tipPose(fit.shape), {}};
  for (const estimation::TagResidual& tag : fit.tags) out.tags.push_back(tag.tag);
  std::sort(out.tags.begin(), out.tags.end());
  return out;
}

}  // namespace

struct SimulatedVision::Workspace {
  Workspace(const CameraSetup& camera, const estimation::ArmView& known,
            const vision::LocalizerConfig& localizer_config, const SimulatedVisionConfig& given)
      : truth(camera.view), nominal(known), min_tags(localizer_config.min_tags), config(given) {
    basics::requireNotNegative("simulated vision",
                               {{"the noise of corners [px]", config.corner_noise},
                                {"the least side of a tag [px]", config.least_side}});
    generator.seed(config.seed);
    if (truth.layout.hasBodies()) {
      SimulatedBodiesConfig seeded = camera.bodies;
      seeded.seed = config.seed;
      bodies.emplace(truth, seeded);
      localizer.emplace(nominal, localizer_config);
    } else if (config.kind == VisionKind::kCorners) {
      fitter.emplace(nominal.layout, nominal.sections, localizer_config.fit);
      if (const auto& by_placements = localizer_config.rig_by_placements) {
        memory.emplace(localizer_config.fit, *by_placements);
        base.emplace(nominal.layout, nominal.sections, localizer_config.fit, *by_placements);
      }
    } else {
      simulated.emplace(camera.view, camera.family, camera.body, camera.config);
      encoder.emplace(camera.config.jpeg_quality);
      localizer.emplace(nominal, localizer_config);
    }
  }

  std::optional<MeasuredShape> fitCorners(const model::Shape& shape, const model::Shape& model) {
    if (!frozen) observe(shape);
    if (static_cast<int>(seen.size()) < min_tags) {
      why_unseen =
          basics::format("%zu tags of the arm are in the picture, and vision.min_tags is %d",
                         seen.size(), min_tags);
      return std::nullopt;
    }
    if (memory) fitter->know(memory->estimate());
    const model::Shape start = last.value_or(model);
    const double focal = nominal.camera.focal();
    if (base) {
      base->see(seen, nominal.X_CB, focal, start, model);
      moved = base->move();
    }
    const estimation::TwistFit& fit = fitter->fit(seen, nominal.X_CB, focal, start, model);
    if (memory) memory->learn(fit);
    last.reset();
    if (fit.status != estimation::FitStatus::kConverged) {
      why_unseen = "no shape of the arm fits the tags in the picture";
      return std::nullopt;
    }
    last = fit.shape;
    return measured(fit);
  }

  void observe(const model::Shape& shape) {
    seen.clear();
    for (const estimation::TagImage& tag : estimation::visibleTags(truth, shape)) {
      if (estimation::longestSide(tag.corners) < config.least_side) continue;
      estimation::Corners corners = tag.corners.colwise() + shift;
      for (double& coordinate : corners.reshaped()) {
        coordinate += config.corner_noise * normal(generator);
      }
      if (const auto direction = estimation::directionsOf(nominal.camera, corners)) {
        seen.push_back({tag.tag, *direction});
      }
    }
  }

  std::optional<MeasuredShape> searchPicture(const model::Shape& shape, const model::Shape& model) {
    why_unseen = "the picture cannot be read, or the camera hangs";
    if ((!frozen || gray.empty()) && !photograph(shape)) return std::nullopt;
    if (frozen_watch.isFrozen(gray, model::tipPose(model).translation)) return std::nullopt;
    const vision::Observation& vision = localizer->locate(gray, model);
    moved = vision.moved;
    why_unseen = basics::format("%zu tags are found in the picture (%s)", vision.detections.size(),
                                nameOf(vision.state));
    if (vision.state != vision::ObservationState::kMeasured) return std::nullopt;
    return measured(vision.fit);
  }

  std::optional<MeasuredShape> locateBodies(const model::Shape& shape, const model::Shape& model) {
    if (!frozen || poses.empty()) poses = bodies->see(shape);
    const vision::Observation& vision = localizer->locate(poses, model);
    moved = vision.moved;
    why_unseen = basics::format("%zu bodies are seen (%s) %s", poses.size(), nameOf(vision.state),
                                vision.fault.c_str());
    if (vision.state != vision::ObservationState::kMeasured) return std::nullopt;
    return measured(vision.fit);
  }

  bool photograph(const model::Shape& shape) {
    cv::Mat picture = simulated->render(shape);
    if (!shift.isZero(0)) {
      const cv::Mat motion = (cv::Mat_<double>(2, 3) << 1, 0, shift.x(), 0, 1, shift.y());
      cv::Mat displaced;
      cv::warpAffine(picture, displaced, motion, picture.size(), cv::INTER_LINEAR,
                     cv::BORDER_REPLICATE);
      picture = displaced;
    }
    const std::vector<std::uint8_t> jpeg = encoder->encode(picture);
    return !decoder.decode(jpeg.data(), jpeg.size(), gray);
  }

  const estimation::ArmView truth, nominal;
  const int min_tags;
  const SimulatedVisionConfig config;
  std::mt19937_64 generator;
  std::normal_distribution<double> normal;
  std::optional<estimation::TwistFitter> fitter;
  std::optional<estimation::RigMemory> memory;
  std::optional<estimation::BaseWatch> base;
  std::optional<estimation::BaseMove> moved;
  std::optional<model::Shape> last;
  std::string why_unseen;                           // by the last look that measured nothing
  Eigen::Vector2d shift = Eigen::Vector2d::Zero();  // of pictures [px]
  bool frozen = false;
  std::vector<estimation::CornerObservation> seen;
  std::optional<SimulatedCamera> simulated;
  std::optional<vision::JpegEncoder> encoder;
  vision::JpegDecoder decoder;
  std::optional<vision::ArmLocalizer> localizer;
  vision::FrozenWatch frozen_watch;
  std::optional<SimulatedBodies> bodies;
  std::vector<estimation::BodyPose> poses;  // the last ones
  cv::Mat gray;                             // the last picture
};

SimulatedVision::SimulatedVision(const CameraSetup& camera, const estimation::ArmView& nominal,
                                 const vision::LocalizerConfig& localizer,
                                 const SimulatedVisionConfig& config)
    : work_(std::make_unique<Workspace>(camera, nominal, localizer, config)) {}
SimulatedVision::~SimulatedVision() = default;
SimulatedVision::SimulatedVision(SimulatedVision&&) noexcept = default;
SimulatedVision& SimulatedVision::operator=(SimulatedVision&&) noexcept = default;

const std::optional<estimation::BaseMove>& SimulatedVision::moved() const { return work_->moved; }
const std::string& SimulatedVision::whyUnseen() const { return work_->why_unseen; }
void SimulatedVision::shift(const Eigen::Vector2d& pixels) { work_->shift = pixels; }
void SimulatedVision::freeze(bool frozen) { work_->frozen = frozen; }

std::optional<MeasuredShape> SimulatedVision::look(const model::Shape& truth,
                                                   const model::Shape& model) {
  if (work_->bodies) return work_->locateBodies(truth, model);
  return work_->config.kind == VisionKind::kCorners ? work_->fitCorners(truth, model)
                                                    : work_->searchPicture(truth, model);
}

}  // namespace helix_arm::simulation
