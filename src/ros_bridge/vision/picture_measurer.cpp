#include "picture_measurer.hpp"

#include <algorithm>
#include <cmath>
#include <variant>

#include "helix_arm/control/target_check.hpp"
#include "helix_arm/model/curve.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"

namespace helix_arm::ros_bridge {
namespace {

using std::chrono::steady_clock;

// Expected shape before the first model arrives.
model::Shape restingShape(const io::Scene& scene) {
  const Eigen::VectorXd rest = scene.arm.inputAt(0);
  const statics::Solution solution = scene.model.solve(rest);
  if (!solution.converged()) {
    logWarning(
        "%s: the model finds no shape of the resting arm (%s, residual %.2g): tags are expected "
        "where they are without load until a model is received",
        scene.name.c_str(), statics::nameOf(solution.status), solution.residual);
  }
  return statics::startingShape(scene.model, solution, rest);
}

}  // namespace

PictureMeasurer::PictureMeasurer(SceneLocalizer first, double stale_after,
                                 const PictureSource& source, VisionStatusPublisher& status)
    : stale_after_(stale_after),
      source_(source),
      status_(status),
      current_(std::move(first)),
      start_(restingShape(current_.scene)) {}

CheckedPicture<Measurement> PictureMeasurer::measure(const Picture& picture) {
  adoptNext();
  if (const auto* bodies = std::get_if<BodySet>(&picture.content)) {
    return measureBodies(picture.stamp, *bodies);
  }
  CheckedPicture<cv::Mat> taken = take(picture);
  if (auto* refusal = std::get_if<PictureRefusal>(&taken)) return std::move(*refusal);
  const cv::Mat& gray = std::get<cv::Mat>(taken);
  follow(picture.stamp);
  auto model = match(picture.stamp, patience_);
  if (model && frozen_watch_.isFrozen(gray, model::tipPose(model->shape).translation)) {
    return PictureRefusal{PictureFault::kSource,
                          "the camera sends the same picture again and again, although the model "
                          "has moved: it hangs; restart its node, or plug it in anew"};
  }
  const vision::Observation& observation = current_.localizer->locate(gray, start_);
  return Measurement{picture.stamp,         gray,
                     observation,           current_.localizer->view(),
                     current_.scene.vision, std::move(model),
                     calibration_,          {}};
}

Measurement PictureMeasurer::measureBodies(const ros::Time& stamp, const BodySet& bodies) {
  follow(stamp);
  auto model = match(stamp, std::chrono::milliseconds(0));
  const vision::Observation& observation = current_.localizer->locate(bodies.poses, start_);
  return Measurement{stamp,
                     {},
                     observation,
                     current_.localizer->view(),
                     current_.scene.vision,
                     std::move(model),
                     {},
                     bodies.frame};
}

void PictureMeasurer::adopt(SceneLocalizer next) {
  const basics::MutexLock lock(mutex_);
  next_ = std::move(next);
}

void PictureMeasurer::addModel(const ros::Time& stamp, const model::Shape& shape) {
  const basics::MutexLock lock(mutex_);
  models_.add(stamp, shape);
  changed_.notifyAll();
}

void PictureMeasurer::addEstimate(const ros::Time& stamp, const model::Shape& shape) {
  const basics::MutexLock lock(mutex_);
  estimates_.add(stamp, shape);
}

void PictureMeasurer::stop() {
  const basics::MutexLock lock(mutex_);
  stop_ = true;
  changed_.notifyAll();
}

void PictureMeasurer::adoptNext() {
  const basics::MutexLock lock(mutex_);
  if (next_) current_ = std::move(*next_);
  next_.reset();
}

CheckedPicture<cv::Mat> PictureMeasurer::take(const Picture& picture) {
  // A picture of the wrong size is refused before decoding, which may take long.
  if (const auto* jpeg = std::get_if<sensor_msgs::CompressedImageConstPtr>(&picture.content)) {
    const auto& data = (*jpeg)->data;
    const cv::Size claimed = vision::JpegDecoder::claimedSize(data.data(), data.size());
    if (!claimed.empty()) {
      if (auto refusal = adoptCamera(claimed)) return std::move(*refusal);
    }
  }
  CheckedPicture<cv::Mat> taken = decode(picture);
  if (const auto* gray = std::get_if<cv::Mat>(&taken)) {
    if (auto refusal = adoptCamera(gray->size())) return std::move(*refusal);
  }
  return taken;
}

CheckedPicture<cv::Mat> PictureMeasurer::decode(const Picture& picture) {
  if (const auto* raw = std::get_if<sensor_msgs::ImageConstPtr>(&picture.content)) {
    return fromMsg(**raw, buffer_);
  }
  if (const auto* jpeg = std::get_if<sensor_msgs::CompressedImageConstPtr>(&picture.content)) {
    return fromMsg(**jpeg, decoder_, buffer_);
  }
  return std::get<cv::Mat>(picture.content);
}

std::optional<PictureRefusal> PictureMeasurer::adoptCamera(const cv::Size& size) {
  estimation::ArmView view = current_.localizer->view();
  std::string whose = kSceneCalibration;
  if (const auto info = source_.cameraInfo()) {
    if (const auto* refusal = std::get_if<PictureRefusal>(&*info)) return *refusal;
    view.camera = std::get<estimation::Camera>(*info);
    whose = "camera_info";
  }
  if (size != cv::Size(view.camera.width, view.camera.height)) {
    return PictureRefusal{PictureFault::kWrongSize,
                          "the picture is of " + sizeText(size.width, size.height) +
                              " pixels, but " + whose + " of " +
                              sizeText(view.camera.width, view.camera.height) +
                              "; a calibration holds for one size only"};
  }
  if (!equal(view.camera, current_.localizer->view().camera)) {
    if (adoptions_.add()) {
      logInfo(
          "camera_info differs from the intrinsics in use (%lu times so far): using "
          "camera_info%s",
          adoptions_.total(),
          source_.infoPublishers() > 1
              ? "; more than one node publishes it: stop all but the camera's"
              : "");
    }
    current_.localizer =
        std::make_unique<vision::ArmLocalizer>(view, procedures::localizerConfigOf(current_.scene));
  }
  if (const std::string& topic = source_.rectifiedTopic();
      view.camera.distorts() && !topic.empty()) {
    whose += ", of a lens that distorts, but the pictures of " + topic +
             " are rectified: remap image to the camera's own";
    if (calibration_ != whose) logWarning("calibration: %s", whose.c_str());
  }
  calibration_ = whose;
  return std::nullopt;
}

std::optional<ModelHistory::Entry> PictureMeasurer::match(const ros::Time& stamp,
                                                          std::chrono::milliseconds patience) {
  basics::MutexLock lock(mutex_);
  const std::optional<double> ahead = models_.lag(stamp);
  models_.forgetFuture(stamp);
  const bool waits = patience.count() > 0 && models_.mayGetNearer(stamp);
  const auto due = steady_clock::now() + patience;
  const bool in_time = changed_.waitUntil(lock, due, [&]() HELIX_ARM_REQUIRES(mutex_) {
    return stop_ || patience.count() == 0 || !models_.mayGetNearer(stamp);
  });
  const std::optional<double> behind = models_.lag(stamp), lag = behind ? behind : ahead;
  std::optional<ModelHistory::Entry> found = models_.nearest(stamp);
  estimates_.forgetFuture(stamp);
  const std::optional<ModelHistory::Entry> estimate = estimates_.nearest(stamp);
  lock.unlock();
  if (!in_time) {
    patience_ = std::max(kLeastPatience, patience_ / 2);
  } else if (waits) {
    patience_ = std::min(kLongestPatience, 2 * patience_);
  }
  status_.modelLag(lag);
  const bool is_late = lag && (!in_time || std::abs(*lag) > ModelHistory::kReach);
  if (is_late && late_models_.add()) {
    logWarning(
        "models are stamped %.3f s %s the pictures (%lu times so far): is pressure_command "
        "running? If so, %s. Without a shape that balances the load there is no model: see `%s` "
        "in its diagnostics",
        std::abs(*lag), *lag < 0 ? "after" : "before", late_models_.total(),
        control::whyLate(std::abs(*lag)), names::kModelStatus);
  }
  if (found) start_ = found->shape;
  // The tips that visual_servo compares have the same deviations from the mean twists.
  if (found && estimate) start_ = estimate->shape.about(found->shape.twists());
  return found;
}

void PictureMeasurer::follow(const ros::Time& stamp) {
  const double elapsed = secondsBetween(last_stamp_, stamp);
  if (elapsed > stale_after_) current_.localizer->reset();
  if (elapsed < 0) {
    current_.localizer->forget();  // a recording that is played again gives the same again
    frozen_watch_.reset();
    if (jumps_.add()) {
      logInfo(
          "the time of the pictures jumped back by %.1f s (%lu times so far): tracking "
          "restarts%s",
          -elapsed, jumps_.total(),
          source_.publishers() > 1 ? "; more than one node publishes pictures: stop all but one"
                                   : "");
    }
    start_ = restingShape(current_.scene);
  }
  last_stamp_ = stamp;
}

}  // namespace helix_arm::ros_bridge
