#include "picture_source.hpp"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>
#include <variant>
#include <vector>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/shipped_files.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"

namespace helix_arm::ros_bridge {
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

std::string readSource(ParameterReader& reader) {
  const std::string source = reader.text("source", kTopicSource);
  std::vector<std::string> words = {kTopicSource, names::kImage, names::kCompressedImage,
                                    kWebcamSource, kPoseSource};
  // Words come first: image/compressed has a slash, and would count as a path.
  const bool is_word = std::find(words.begin(), words.end(), source) != words.end();
  std::error_code fault;  // counts as not there
  if (!is_word && !source.empty() &&
      (io::isPath(source) || std::filesystem::exists(source, fault))) {
    return reader.absolute("source", source);
  }
  words.emplace_back("a path (with a / or a ., or of what is there)");
  return reader.choice("source", kTopicSource, words);
}

PoseOptions readPoses(ParameterReader& reader) {
  PoseOptions out;
  out.tf = reader.flag("tf", false);
  out.topics = reader.text("topics", out.tf ? "NAME" : "mocap/NAME/pose");
  out.together = reader.number("together_s", out.together, {0.0, 0.1});
  return out;
}

PictureSource::PictureSource(ros::NodeHandle& node, const VisionOptions& options,
                             const io::Scene& scene, VisionStatusPublisher& status)
    : options_(options),
      status_(status),
      lease_(options.stale_after),
      frames_(openFrames(options, scene)) {
  const bool has_url = !options_.camera_info_url.empty();
  basics::require(frames_ != nullptr || !has_url, "~camera_info_url is ", options_.camera_info_url,
                  ", but the calibration of ~source ", options_.source,
                  " comes on camera_info; leave ~camera_info_url empty, or set ~source to webcam "
                  "or a file");
  if (options_.fromBodies()) {
    poses_.emplace(
        node, options_.poses, *scene.tags, [this](Picture set) { arrived(std::move(set)); },
        [this](const PictureRefusal& refusal) { status_.count(refusal); });
    return;
  }
  using Self = PictureSource;
  for (const char* topic : {names::kImage, names::kCompressedImage}) {
    const std::string name = node.resolveName(topic);
    if (options_.fromTopic(topic) && name.find("image_rect") != std::string::npos) {
      rectified_ = name;
    }
  }
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
    basics::require(calibration_->isCalibrated(), "~camera_info_url is ", options_.camera_info_url,
                    "; expected the URL of a calibration as camera_calibration of ROS writes it "
                    "(image_width, image_height, camera_name, camera_matrix {rows, cols, data}, "
                    "distortion_model, distortion_coefficients); files of cv::FileStorage, which "
                    "begin with %YAML:1.0, are not");
    const auto camera = fromMsg(calibration_->getCameraInfo());
    if (const auto* refusal = std::get_if<PictureRefusal>(&camera)) {
      throw std::invalid_argument("~camera_info_url is " + options_.camera_info_url + "; its " +
                                  refusal->message);
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

std::optional<CheckedPicture<estimation::Camera>> PictureSource::cameraInfo() const {
  const basics::MutexLock lock(mutex_);
  return camera_info_;
}

std::uint32_t PictureSource::publishers() const {
  return std::max(image_subscriber_.getNumPublishers(), compressed_subscriber_.getNumPublishers());
}

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
  // Only counted here; the state is derived from the pictures.
  if (const auto* refusal = std::get_if<PictureRefusal>(&camera)) status_.count(*refusal);
  const basics::MutexLock lock(mutex_);
  camera_info_ = camera;
}

void PictureSource::capture() {
  const steady_clock::duration period = toDuration(1.0 / options_.file_rate);
  vision::Frame frame;
  for (bool go_on = true; go_on;) {
    const auto due = steady_clock::now() + period;
    const vision::FrameStatus status = frames_->next(frame);
    if (status == vision::FrameStatus::kEnd) {
      return status_.enter(VisionStatus::ENDED, options_.source + " has ended");
    }
    if (status == vision::FrameStatus::kFault) {
      status_.refuse({PictureFault::kSource, frame.fault});
      const double pause = std::max(kFaultPause, std::min(frame.retry_after, kLongestPause));
      go_on = mailbox_.sleepUntil(steady_clock::now() + toDuration(pause));
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

void PictureSource::arrived(Picture picture) {
  if (mailbox_.stopped()) return;
  // Counted before it becomes available to the worker.
  status_.arrived();
  if (mailbox_.put(std::move(picture))) status_.skipped();
}

}  // namespace helix_arm::ros_bridge
