#include "picture_source.hpp"

#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

bool PictureMailbox::put(Picture picture) {
  bool replaces = false;
  {
    const basics::MutexLock lock(mutex_);
    replaces = next_.has_value();
    next_ = std::move(picture);
  }
  changed_.notifyAll();
  return replaces;
}

std::optional<Picture> PictureMailbox::take() {
  basics::MutexLock lock(mutex_);
  changed_.wait(lock, [this]() HELIX_ARM_REQUIRES(mutex_) { return stop_ || next_; });
  if (stop_) return std::nullopt;
  busy_ = true;
  return std::exchange(next_, std::nullopt);
}

void PictureMailbox::done() {
  {
    const basics::MutexLock lock(mutex_);
    busy_ = false;
  }
  changed_.notifyAll();
}

bool PictureMailbox::waitUntilIdle() {
  basics::MutexLock lock(mutex_);
  changed_.wait(lock, [this]() HELIX_ARM_REQUIRES(mutex_) { return stop_ || (!next_ && !busy_); });
  return !stop_;
}

bool PictureMailbox::sleepUntil(std::chrono::steady_clock::time_point due) {
  basics::MutexLock lock(mutex_);
  return !changed_.waitUntil(lock, due, [this]() HELIX_ARM_REQUIRES(mutex_) { return stop_; });
}

void PictureMailbox::stop() {
  {
    const basics::MutexLock lock(mutex_);
    stop_ = true;
  }
  changed_.notifyAll();
}

bool PictureMailbox::stopped() const {
  const basics::MutexLock lock(mutex_);
  return stop_;
}

namespace {

using std::chrono::steady_clock;

constexpr double kFaultPause = 0.05;      // between faults of a source [s]
constexpr double kLongestPause = 3600.0;  // between tries of a webcam [s]

steady_clock::duration toDuration(double seconds) {
  return std::chrono::duration_cast<steady_clock::duration>(std::chrono::duration<double>(seconds));
}

std::unique_ptr<vision::FrameSource> openFrames(const VisionOptions& options,
                                                const io::Scene& scene) {
  if (options.fromWebcam()) return vision::FrameSource::webcam(*scene.camera->webcam);
  if (options.fromFile()) return vision::FrameSource::files(options.source);
  return nullptr;
}

}  // namespace

PictureSource::PictureSource(ros::NodeHandle& node, const VisionOptions& options,
                             const io::Scene& scene, VisionStatusPublisher& status)
    : options_(options),
      status_(status),
      lease_(options.stale_after),
      frames_(openFrames(options, scene)) {
  const bool has_url = !options_.camera_info_url.empty();
  if (frames_ == nullptr && has_url) {
    throw std::invalid_argument("~camera_info_url is " + options_.camera_info_url +
                                ", but the calibration of ~source " + options_.source +
                                " comes on camera_info; leave ~camera_info_url empty, or set "
                                "~source to webcam or a file");
  }
  using Self = PictureSource;
  if (options_.fromTopic(names::kImage)) {
    image_subscriber_ = listen(node, names::kImage, 1, &Self::onImage, this);
  }
  if (options_.fromTopic(names::kCompressedImage)) {
    compressed_subscriber_ = listen(node, names::kCompressedImage, 1, &Self::onCompressed, this);
  }
  if (frames_ == nullptr && options_.use_camera_info) {
    info_subscriber_ = listen(node, names::kCameraInfo, 1, &Self::onCameraInfo, this);
  }
  if (frames_ != nullptr && has_url) {
    calibration_ = std::make_unique<camera_info_manager::CameraInfoManager>(
        node, "camera", options_.camera_info_url);
    if (!calibration_->isCalibrated()) {
      throw std::invalid_argument("~camera_info_url is " + options_.camera_info_url +
                                  "; expected the URL of a calibration");
    }
  }
}

PictureSource::~PictureSource() {
  stop();
  join();
}

void PictureSource::start(std::function<void()> on_failure) {
  if (frames_ != nullptr) capturer_.start([this] { capture(); }, std::move(on_failure));
}

void PictureSource::stop() { mailbox_.stop(); }

void PictureSource::join() { capturer_.join(); }

std::optional<CheckedPicture<estimation::Camera>> PictureSource::cameraInfo() const {
  const basics::MutexLock lock(mutex_);
  return camera_info_;
}

std::uint32_t PictureSource::publishers() const {
  return std::max(image_subscriber_.getNumPublishers(), compressed_subscriber_.getNumPublishers());
}

std::uint32_t PictureSource::infoPublishers() const { return info_subscriber_.getNumPublishers(); }

template <class Message>
void PictureSource::onPicture(const boost::shared_ptr<const Message>& picture, const char* topic) {
  if (!lease_.claim(topic, ros::SteadyTime::now().toSec())) return;
  ros::Time stamp = picture->header.stamp;
  if (stamp.isZero()) {
    stamp = ros::Time::now();
    if (unstamped_.add()) {
      logWarning(
          "pictures on %s have no stamp (%lu so far): stamped on arrival, later than they "
          "were taken; let the camera's node stamp them",
          topic, unstamped_.total());
    }
  }
  arrived({stamp, picture});
}

void PictureSource::onImage(const sensor_msgs::ImageConstPtr& image) {
  onPicture(image, names::kImage);
}

void PictureSource::onCompressed(const sensor_msgs::CompressedImageConstPtr& image) {
  onPicture(image, names::kCompressedImage);
}

void PictureSource::onCameraInfo(const sensor_msgs::CameraInfoConstPtr& info) {
  const CheckedPicture<estimation::Camera> camera = fromMsg(*info);
  {
    const basics::MutexLock lock(mutex_);
    camera_info_ = camera;
  }
  // Only counted here; the state is derived from the pictures.
  if (const auto* refusal = std::get_if<PictureRefusal>(&camera)) status_.count(*refusal);
}

void PictureSource::arrived(Picture picture) {
  if (mailbox_.stopped()) return;
  // Counted before it becomes available to the worker.
  status_.arrived();
  if (mailbox_.put(std::move(picture))) status_.skipped();
}

bool PictureSource::pauseAfterFault(double retry_after) {
  const double pause = std::max(kFaultPause, std::min(retry_after, kLongestPause));
  return mailbox_.sleepUntil(steady_clock::now() + toDuration(pause));
}

void PictureSource::capture() {
  const steady_clock::duration period = toDuration(1.0 / options_.file_rate);
  vision::Frame frame;
  for (bool go_on = true; go_on;) {
    const auto due = steady_clock::now() + period;
    const vision::FrameStatus status = frames_->next(frame);
    if (status == vision::FrameStatus::kEnd) {
      status_.enter(VisionStatus::ENDED, options_.source + " has ended");
      return;
    }
    if (status == vision::FrameStatus::kFault) {
      status_.refuse({PictureFault::kSource, frame.fault});
      go_on = pauseAfterFault(frame.retry_after);
      continue;
    }
    if (calibration_ != nullptr) {
      const auto camera = fromMsg(calibration_->getCameraInfo());
      const basics::MutexLock lock(mutex_);
      camera_info_ = camera;
    }
    // Cloned, since the source reuses its memory for the next picture.
    arrived({ros::Time::now(), frame.gray.clone()});
    go_on = options_.fromFile() ? mailbox_.sleepUntil(due) && mailbox_.waitUntilIdle()
                                : !mailbox_.stopped();
  }
}

}  // namespace helix_arm::ros_bridge
