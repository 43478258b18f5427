#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>
#include <variant>
#include <vector>

#include <camera_info_manager/camera_info_manager.h>
#include <ros/node_handle.h>
#include <ros/time.h>

#include "basics/mutex.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/control/commander_lease.hpp"
#include "helix_arm/io/scene.hpp"
#include "io/scene/shipped_files.hpp"
#include "observations.hpp"
#include "pose_source.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"
#include "vision/frame_source.hpp"

namespace helix_arm::ros_bridge {

/// Value of ~source: one of these words, or the absolute path of a video, picture or folder.
inline constexpr char kTopicSource[] = "topic", kWebcamSource[] = "webcam", kPoseSource[] = "poses";

/// Private parameters of vision.
struct VisionOptions {
  ParameterReader reader;
  std::string scene = reader.file("scene", "config/scenes", ".yaml");  ///< as pressure_command's
  /// `topic` (image and image/compressed, whichever speaks first), one of these two alone, `webcam`
  /// (the scene's camera.webcam), or the path of a video, picture or folder; `poses` of the scene's
  /// motion-capture bodies.
  std::string source = readSource(reader);
  PoseOptions poses = readPoses(reader);
  bool use_camera_info = reader.flag("use_camera_info", true);  ///< else the scene's intrinsics
  std::string camera_info_url = reader.text("camera_info_url", "");    ///< of a webcam or file
  double file_rate = reader.number("file_rate", 15.0, {0.1, 1000.0});  ///< pictures of a file [Hz]
  double draw_rate = reader.number("draw_rate", 20.0, {0.1, 100.0});   ///< of markers, overlay [Hz]
  double stale_after = reader.number("stale_after_s", 1.0, {0.05, 60.0});  ///< without pictures [s]
  /// The pictures of a webcam or file also on image, with camera_info.
  bool publish_image = reader.flag("publish_image", false);
  int frames = reader.count("frames", 5, 2, 1000);  ///< measured_0 .. measured_(frames - 1)
  std::string world_frame = reader.frame("world_frame", names::kWorldFrame);
  std::string frame_prefix = reader.frame("frame_prefix", "");  ///< of arm_base and measured_*
  bool optional = reader.flag("optional", false);  ///< a scene without camera or tags is no fault
  /// Folder from which ~reload takes scenes, besides the package's and ~scene.
  std::string scene_folder = reader.folder("scene_folder", defaultFolder());

  explicit VisionOptions(const ros::NodeHandle& private_node) : reader(private_node) {
    reader.finish();
  }

  /// Poses of bodies come in place of pictures.
  bool fromBodies() const { return source == kPoseSource; }
  /// Pictures come from the scene's webcam.
  bool fromWebcam() const { return source == kWebcamSource; }
  /// Pictures come from a video, a picture or a folder.
  bool fromFile() const { return source.compare(0, 1, "/") == 0; }
  /// Pictures come from this topic: names::kImage or names::kCompressedImage.
  bool fromTopic(const std::string& topic) const {
    return source == kTopicSource || source == topic;
  }
  /// Name of the camera's frame, with the prefix.
  std::string cameraFrame() const { return frame_prefix + names::kCameraFrame; }

 private:
  static std::string readSource(ParameterReader& reader) {
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

  /// `~tf`, `~topics` and `~together_s`.
  static PoseOptions readPoses(ParameterReader& reader) {
    PoseOptions out;
    out.tf = reader.flag("tf", false);
    out.topics = reader.text("topics", out.tf ? "NAME" : "mocap/NAME/pose");
    out.together = reader.number("together_s", out.together, {0.0, 0.1});
    return out;
  }
};

/// Where pictures and the camera's calibration come from: the topics image, image/compressed and
/// camera_info, or a webcam or file, read by a thread of its own. Or poses of bodies: PoseSource.
///
/// The first of two picture topics to speak is used until it is silent for
/// VisionOptions::stale_after. The latest picture replaces one that waits to be taken; files are
/// read at the pace of the taker. A picture stamped 0 is stamped on arrival, with a warning.
class PictureSource {
 public:
  /// Subscribes; reads no picture of a webcam or file before start().
  /// @param status  is told of arrivals and faults; outlives this.
  /// @throws std::invalid_argument on a source that cannot be opened or calibrated.
  PictureSource(ros::NodeHandle& node, const VisionOptions& options, const io::Scene& scene,
                VisionStatusPublisher& status)
      : options_(options),
        status_(status),
        lease_(options.stale_after),
        frames_(openFrames(options, scene)) {
    const bool has_url = !options_.camera_info_url.empty();
    basics::require(frames_ != nullptr || !has_url, "~camera_info_url is ",
                    options_.camera_info_url, ", but the calibration of ~source ", options_.source,
                    " comes on camera_info; leave ~camera_info_url empty, or set ~source to webcam "
                    "or a file");
    if (options_.fromBodies()) {
      poses_.emplace(
          node, options_.poses, *scene.tags, [this](Picture set) { arrived(std::move(set)); },
          [this](const PictureRefusal& refusal) { status_.count(refusal); });
      return;
    }
    image_subscriber_ = hear<sensor_msgs::Image>(node, names::kImage);
    compressed_subscriber_ = hear<sensor_msgs::CompressedImage>(node, names::kCompressedImage);
    if (frames_ == nullptr && options_.use_camera_info) {
      info_subscriber_ = listen(node, names::kCameraInfo, 1, &PictureSource::onCameraInfo, this);
    }
    if (frames_ != nullptr && has_url) {
      calibration_ = std::make_unique<camera_info_manager::CameraInfoManager>(
          node, "camera", options_.camera_info_url);
      basics::require(calibration_->isCalibrated(), "~camera_info_url is ",
                      options_.camera_info_url,
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
  /// Stops, and waits for the thread to end.
  ~PictureSource() {
    stop();
    join();
  }

  /// Starts the thread of a webcam or file; does nothing for topics.
  /// @param on_failure  called by the thread, last of all, if it failed.
  void start(std::function<void()> on_failure) {
    if (frames_ != nullptr) capturer_.start([this] { capture(); }, std::move(on_failure));
  }
  /// From any thread: take() gives no more pictures, and the thread ends.
  void stop() { mailbox_.stop(); }
  void join() { capturer_.join(); }
  /// Exit code of the thread: kDone unless it failed.
  int verdict() const { return capturer_.verdict(); }

  /// Waits for the next picture, to be followed by done(). For one thread.
  /// @return nothing once stopped.
  std::optional<Picture> take() { return mailbox_.take(); }
  void done() { mailbox_.done(); }

  /// The last camera_info, or the calibration of ~camera_info_url; nothing where none came, so that
  /// the scene's intrinsics hold. From any thread.
  std::optional<CheckedPicture<estimation::Camera>> cameraInfo() const HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    return camera_info_;
  }

  /// The topic of rectified pictures by its name, as that of image_proc; empty if none is. From any
  /// thread.
  const std::string& rectifiedTopic() const { return rectified_; }

  /// Number of nodes that publish pictures on a topic. From any thread.
  std::uint32_t publishers() const {
    return std::max(image_subscriber_.getNumPublishers(),
                    compressed_subscriber_.getNumPublishers());
  }
  /// Number of nodes that publish camera_info. From any thread.
  std::uint32_t infoPublishers() const { return info_subscriber_.getNumPublishers(); }

 private:
  using Clock = std::chrono::steady_clock;

  static constexpr double kFaultPause = 0.05;      ///< between faults of a source [s]
  static constexpr double kLongestPause = 3600.0;  ///< between tries of a webcam [s]

  static Clock::duration toDuration(double seconds) {
    return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  }

  static std::unique_ptr<vision::FrameSource> openFrames(const VisionOptions& options,
                                                         const io::Scene& scene) {
    if (options.fromWebcam()) return vision::FrameSource::webcam(*scene.camera->webcam);
    if (options.fromFile()) return vision::FrameSource::files(options.source);
    return nullptr;
  }

  /// Subscribes to a topic of pictures, if they come from it.
  template <class Message>
  ros::Subscriber hear(ros::NodeHandle& node, const char* topic) {
    if (!options_.fromTopic(topic)) return {};
    const std::string name = node.resolveName(topic);
    if (name.find("image_rect") != std::string::npos) rectified_ = name;
    return listen<Message>(node, topic, 1, [this, topic](const auto& event) {
      onPicture(event.getConstMessage(), topic);
    });
  }

  // Callbacks.
  void onCameraInfo(const sensor_msgs::CameraInfoConstPtr& info) HELIX_ARM_EXCLUDES(mutex_) {
    const CheckedPicture<estimation::Camera> camera = fromMsg(*info);
    // Only counted here; the state is derived from the pictures.
    if (const auto* refusal = std::get_if<PictureRefusal>(&camera)) status_.count(*refusal);
    const basics::MutexLock lock(mutex_);
    camera_info_ = camera;
  }

  template <class Message>
  void onPicture(const boost::shared_ptr<const Message>& picture, const char* topic) {
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

  // Thread of the webcam or file.
  void capture() HELIX_ARM_EXCLUDES(mutex_) {
    const Clock::duration period = toDuration(1.0 / options_.file_rate);
    vision::Frame frame;
    for (bool go_on = true; go_on;) {
      const auto due = Clock::now() + period;
      const vision::FrameStatus status = frames_->next(frame);
      if (status == vision::FrameStatus::kEnd) {
        return status_.enter(VisionStatus::ENDED, options_.source + " has ended");
      }
      if (status == vision::FrameStatus::kFault) {
        status_.refuse({PictureFault::kSource, frame.fault});
        const double pause = std::max(kFaultPause, std::min(frame.retry_after, kLongestPause));
        go_on = mailbox_.sleepUntil(Clock::now() + toDuration(pause));
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

  // From callbacks, or from the thread of the webcam or file.
  void arrived(Picture picture) {
    if (mailbox_.stopped()) return;
    // Counted before it becomes available to the worker.
    status_.arrived();
    if (mailbox_.put(std::move(picture))) status_.skipped();
  }

  const VisionOptions options_;
  VisionStatusPublisher& status_;
  std::string rectified_;
  PictureMailbox mailbox_;

  // Used by callbacks only.
  control::CommanderLease lease_;  ///< which of the two picture topics is listened to
  FaultCount unstamped_;

  // Used by the thread of the webcam or file only; null with topics.
  std::unique_ptr<vision::FrameSource> frames_;
  std::unique_ptr<camera_info_manager::CameraInfoManager> calibration_;

  mutable basics::Mutex mutex_;
  std::optional<CheckedPicture<estimation::Camera>> camera_info_ HELIX_ARM_GUARDED_BY(mutex_);

  std::optional<PoseSource> poses_;  ///< used by callbacks only
  ros::Subscriber image_subscriber_, compressed_subscriber_, info_subscriber_;
  GuardedThread capturer_;
};

}  // namespace helix_arm::ros_bridge
