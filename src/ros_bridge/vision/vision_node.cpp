#include <filesystem>
#include <system_error>

#include <camera_info_manager/camera_info_manager.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include "helix_arm/control/commander_lease.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/shipped_files.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/procedures/loop_config.hpp"
#include "helix_arm/vision/frame_source.hpp"
#include "observations.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr char kTopic[] = "topic";
constexpr char kWebcam[] = "webcam";

// ~source: a word, or the absolute path of a video, picture or folder.
std::string readSource(ParameterReader& reader) {
  const std::string source = reader.text("source", kTopic);
  std::vector<std::string> words = {kTopic, names::kImage, names::kCompressedImage, kWebcam};
  // Words come first: image/compressed has a slash, and would count as a path.
  const bool is_word = std::find(words.begin(), words.end(), source) != words.end();
  std::error_code fault;  // counts as not there
  if (!is_word && !source.empty() &&
      (io::isPath(source) || std::filesystem::exists(source, fault))) {
    return reader.absolute("source", source);
  }
  words.emplace_back("a path (with a / or a ., or of what is there)");
  return reader.choice("source", kTopic, words);
}

/// Private parameters of vision.
struct VisionOptions {
  ParameterReader reader;
  std::string scene = reader.file("scene", "config/scenes", ".yaml");  ///< as pressure_command's
  /// `topic` (image and image/compressed, whichever speaks first), one of these two alone, `webcam`
  /// (the scene's camera.webcam), or the path of a video, picture or folder.
  std::string source = readSource(reader);
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
  /// From which ~reload takes scenes, besides the package's and ~scene.
  std::string scene_folder = reader.folder("scene_folder", defaultFolder());

  explicit VisionOptions(const ros::NodeHandle& private_node) : reader(private_node) {
    reader.finish();
  }

  /// Pictures come from the scene's webcam.
  bool fromWebcam() const { return source == kWebcam; }
  /// Pictures come from a video, a picture or a folder.
  bool fromFile() const { return source.compare(0, 1, "/") == 0; }
  /// Pictures come from this topic: names::kImage or names::kCompressedImage.
  bool fromTopic(const std::string& topic) const { return source == kTopic || source == topic; }
  /// Name of the camera's frame, with the prefix.
  std::string cameraFrame() const { return frame_prefix + names::kCameraFrame; }
};

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

/// Where pictures and the camera's calibration come from: the topics image, image/compressed and
/// camera_info, or a webcam or file, read by a thread of its own.
///
/// Of two picture topics the first to speak is used until it is silent for
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
      basics::require(calibration_->isCalibrated(), "~camera_info_url is ",
                      options_.camera_info_url,
                      "; expected the URL of a calibration as camera_calibration of ROS writes it "
                      "(image_width, image_height, camera_name, camera_matrix {rows, cols, data}, "
                      "distortion_model, distortion_coefficients); files of cv::FileStorage, which "
                      "begin with %YAML:1.0, are not");
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
  // Callbacks.
  void onImage(const sensor_msgs::ImageConstPtr& image) { onPicture(image, names::kImage); }
  void onCompressed(const sensor_msgs::CompressedImageConstPtr& image) {
    onPicture(image, names::kCompressedImage);
  }

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

  ros::Subscriber image_subscriber_, compressed_subscriber_, info_subscriber_;
  GuardedThread capturer_;
};

// Time that a picture waits for the model of its stamp. At 100 Hz and more the model has arrived by
// then, so a replay uses the same models.
constexpr std::chrono::milliseconds kModelPatience(100);

// Each wait in vain halves the patience, down to this: late models do not slow the pictures down.
constexpr std::chrono::milliseconds kLeastPatience(5);

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

/// A scene with camera and tags, and the localizer that looks for them.
struct SceneLocalizer {
  io::Scene scene;
  std::unique_ptr<vision::ArmLocalizer> localizer;

  /// @throws std::invalid_argument naming the value and its rule.
  explicit SceneLocalizer(io::Scene of)
      : scene(std::move(of)),
        localizer(std::make_unique<vision::ArmLocalizer>(scene.view(),
                                                         procedures::localizerConfigOf(scene))) {}
};

/// Measures the arm in one picture after another: checks size and camera, decodes, finds the model
/// of its time, tracks the tags and fits the shape.
///
/// A picture stamped before the last one is a jump back in time: nothing from before it is used.
/// One that equals the last one although the model has moved is refused: the camera hangs.
class PictureMeasurer {
 public:
  /// @param stale_after  after a longer gap between pictures tags are not tracked [s].
  /// @param source       gives the camera's calibration; outlives this.
  /// @param status       is told how far models are behind the pictures; outlives this.
  PictureMeasurer(SceneLocalizer first, double stale_after, const PictureSource& source,
                  VisionStatusPublisher& status)
      : stale_after_(stale_after),
        source_(source),
        status_(status),
        current_(std::move(first)),
        start_(restingShape(current_.scene)) {}

  /// Measures the shape. For one thread.
  /// @return why the picture is not taken, or what was seen in it.
  CheckedPicture<Measurement> measure(const Picture& picture) HELIX_ARM_EXCLUDES(mutex_) {
    adoptNext();
    CheckedPicture<cv::Mat> taken = take(picture);
    if (auto* refusal = std::get_if<PictureRefusal>(&taken)) return std::move(*refusal);
    const cv::Mat& gray = std::get<cv::Mat>(taken);
    follow(picture.stamp);
    auto model = match(picture.stamp);
    if (model && frozen_watch_.isFrozen(gray, model::tipPose(model->shape).translation)) {
      return PictureRefusal{PictureFault::kSource,
                            "the camera sends the same picture again and again, although the model "
                            "has moved: it hangs; restart its node, or plug it in anew"};
    }
    const vision::Observation& observation = current_.localizer->locate(gray, start_);
    return Measurement{picture.stamp,         gray,
                       observation,           current_.localizer->view(),
                       current_.scene.vision, std::move(model),
                       calibration_};
  }

  /// Another file of the same rig, used from the next picture on. From any thread.
  void adopt(SceneLocalizer next) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    next_ = std::move(next);
  }
  /// From any thread.
  void addModel(const ros::Time& stamp, const model::Shape& shape) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    models_.add(stamp, shape);
    changed_.notifyAll();
  }
  /// What visual_servo has learnt of the shape. From any thread.
  void addEstimate(const ros::Time& stamp, const model::Shape& shape) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    estimates_.add(stamp, shape);
  }
  /// From any thread: measure() waits for no model any more.
  void stop() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    stop_ = true;
    changed_.notifyAll();
  }

 private:
  void adoptNext() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    if (next_) current_ = std::move(*next_);
    next_.reset();
  }

  /// The picture in gray, of the size of the camera that is used for it.
  CheckedPicture<cv::Mat> take(const Picture& picture) {
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

  CheckedPicture<cv::Mat> decode(const Picture& picture) {
    if (const auto* raw = std::get_if<sensor_msgs::ImageConstPtr>(&picture.content)) {
      return fromMsg(**raw, buffer_);
    }
    if (const auto* jpeg = std::get_if<sensor_msgs::CompressedImageConstPtr>(&picture.content)) {
      return fromMsg(**jpeg, decoder_, buffer_);
    }
    return std::get<cv::Mat>(picture.content);
  }

  /// Uses the camera that holds now, if it is of this size.
  std::optional<PictureRefusal> adoptCamera(const cv::Size& size) {
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
      current_.localizer = std::make_unique<vision::ArmLocalizer>(
          view, procedures::localizerConfigOf(current_.scene));
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

  /// The model nearest to the stamp, if there is one within ModelHistory::kReach. Waits for a
  /// limited time while one that is yet to come may be nearer.
  std::optional<ModelHistory::Entry> match(const ros::Time& stamp) HELIX_ARM_EXCLUDES(mutex_) {
    basics::MutexLock lock(mutex_);
    const std::optional<double> ahead = models_.lag(stamp);
    models_.forgetFuture(stamp);
    const bool waits = models_.mayGetNearer(stamp);
    const auto due = steady_clock::now() + patience_;
    const bool in_time = changed_.waitUntil(lock, due, [&]() HELIX_ARM_REQUIRES(mutex_) {
      return stop_ || !models_.mayGetNearer(stamp);
    });
    const std::optional<double> behind = models_.lag(stamp), lag = behind ? behind : ahead;
    std::optional<ModelHistory::Entry> found = models_.nearest(stamp);
    estimates_.forgetFuture(stamp);
    const std::optional<ModelHistory::Entry> estimate = estimates_.nearest(stamp);
    lock.unlock();
    if (!in_time) {
      patience_ = std::max(kLeastPatience, patience_ / 2);
    } else if (waits) {
      patience_ = std::min(kModelPatience, 2 * patience_);
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

  /// Forgets what a gap or a jump back in time makes useless.
  void follow(const ros::Time& stamp) {
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

  const double stale_after_;
  const PictureSource& source_;
  VisionStatusPublisher& status_;

  // Used by the thread of the measurements only.
  SceneLocalizer current_;
  model::Shape start_;  ///< from which the search starts: the last model matched
  std::chrono::milliseconds patience_ = kModelPatience;
  vision::FrozenWatch frozen_watch_;
  vision::JpegDecoder decoder_;
  cv::Mat buffer_;
  std::string calibration_;  ///< whose intrinsics are used
  ros::Time last_stamp_;
  FaultCount jumps_, adoptions_, late_models_;

  basics::Mutex mutex_;
  basics::Condition changed_;  ///< something guarded by mutex_ has changed
  bool stop_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  ModelHistory models_ HELIX_ARM_GUARDED_BY(mutex_), estimates_ HELIX_ARM_GUARDED_BY(mutex_);
  std::optional<SceneLocalizer> next_ HELIX_ARM_GUARDED_BY(mutex_);
};

constexpr double kSilencePeriod = 0.05;  // [s]

// Checks that the scene has a camera and tags.
io::Scene requireVision(io::Scene scene, const VisionOptions& options) {
  std::string missing;
  if (!scene.camera) missing += "`camera`";
  if (!scene.tags) missing += missing.empty() ? "`tags`" : " and `tags`";
  if (!missing.empty()) {
    const std::string message = "scene " + scene.name + " has no " + missing + ": nothing to see";
    if (options.optional) throw NothingToDo(message);
    throw std::invalid_argument(message + "; add what is missing to it");
  }
  basics::require(!options.fromWebcam() || scene.camera->webcam, "scene ", scene.name,
                  " has no camera.webcam; add it, or set ~source to topic");
  basics::require(!options.publish_image || options.fromWebcam() || options.fromFile(),
                  "~publish_image is true, but the pictures of ~source ", options.source,
                  " come from a topic already; leave it false, or set ~source to webcam or a file");
  return scene;
}

// Pictures are not exactly periodic; one slightly early must not be skipped.
constexpr double kDrawingSlack = 0.9;

/// Measures the shape of a scene's arm from pictures of its tags, and compares the model with it:
/// the node vision of docs/nodes.md. Parameters: VisionOptions.
///
/// A bad picture or camera_info is counted, warned of at a limited rate and reported on
/// vision_status, not measured. A steady clock tells whether pictures come; all else is by stamps.
class VisionNode : public Node {
 public:
  /// Whose process it lives in: a fault in its threads ends its own, but not a nodelet manager's.
  enum class Host { kOwnProcess, kManager };

  /// @param node          where topics are relative to.
  /// @param private_node  where parameters are; names the node in diagnostics.
  /// @throws io::DocumentError or std::invalid_argument with every fault found; NothingToDo.
  VisionNode(const ros::NodeHandle& node, const ros::NodeHandle& private_node, Host host)
      : host_(host),
        options_(private_node),
        name_(private_node.getNamespace()),
        frames_(options_.world_frame, options_.frame_prefix, names::kMeasuredFrames,
                options_.frames),
        scene_(requireVision(io::loadScene(options_.scene), options_)),
        node_(node),
        status_(node_, name_, frames_.base, options_.source, options_.stale_after,
                1.0 / options_.draw_rate),
        source_(node_, options_, scene_, status_),
        measurer_(SceneLocalizer(scene_), options_.stale_after, source_, status_) {
    if (options_.publish_image) {
      image_publisher_ = node_.advertise<sensor_msgs::Image>(names::kImage, 2);
      info_publisher_ = node_.advertise<sensor_msgs::CameraInfo>(names::kCameraInfo, 2);
    }
    sendCameraFrame();
    status_.lookAt(scene_);
    using Self = VisionNode;
    model_subscriber_ = listen(node_, names::kModel, 100, &Self::onModel, this);
    estimate_subscriber_ = listen(node_, names::kEstimate, 10, &Self::onEstimate, this);
    reload_ = std::make_unique<ReloadServer>(private_node, options_.scene, options_.scene_folder,
                                             [this](io::Scene next) { adopt(std::move(next)); });
    watch_timer_ = repeat(node_, "the watch of the pictures", kSilencePeriod, &Self::onWatch, this);
    second_timer_ = repeat(node_, "the diagnostics", 1.0, &Self::onSecond, this);
    const auto on_failure = [this] { onFailure(); };
    try {
      worker_.start([this] { work(); }, on_failure);
      source_.start(on_failure);
    } catch (...) {
      end();  // no destructor runs here, and those of the members wait for their threads
      throw;
    }
    logInfo("%s: looks for %d tags of family %s, pictures from %s", scene_.name.c_str(),
            static_cast<int>(scene_.tags->tags.size()), scene_.vision.detector.family.c_str(),
            options_.source.c_str());
  }

  ~VisionNode() override { end(); }

  int finish() override {
    return worker_.verdict() != kDone ? worker_.verdict() : source_.verdict();
  }

 private:
  // Callbacks.
  void onModel(const ArmShapeConstPtr& model) {
    if (const auto shape = checked(*model, "a model")) {
      measurer_.addModel(model->header.stamp, *shape);
    }
  }
  void onEstimate(const ArmShapeConstPtr& estimate) {
    if (const auto shape = checked(*estimate, "an estimate")) {
      measurer_.addEstimate(estimate->header.stamp, *shape);
    }
  }

  // Nothing on a shape of another arm, which is counted: the picture is measured without it.
  std::optional<model::Shape> checked(const ArmShape& message, const char* what) {
    auto shape = fromMsg(message, scene_.arm, frames_.base);
    if (auto* sound = std::get_if<model::Shape>(&shape)) return std::move(*sound);
    status_.count({PictureFault::kBadModel, std::string(what) + " does not match scene " +
                                                scene_.name + ": " +
                                                std::get<control::Refusal>(shape).message});
    return std::nullopt;
  }

  void onWatch(const ros::SteadyTimerEvent&) { status_.watch(); }
  void onSecond(const ros::SteadyTimerEvent&) { status_.report(scene_); }

  void adopt(io::Scene next) {
    VisionOptions asked = options_;
    asked.optional = false;
    next = requireVision(std::move(next), asked);
    requireSameRig(scene_, next);
    watched_.requireFree();
    SceneLocalizer localizer(next);
    scene_ = std::move(next);
    sendCameraFrame();
    status_.lookAt(scene_);
    measurer_.adopt(std::move(localizer));
  }

  void sendCameraFrame() {
    static_tf_.sendTransform(
        worldTransform(frames_.world, options_.cameraFrame(), scene_.camera->X_WC));
  }

  // In the thread that failed.
  void onFailure() {
    if (host_ == Host::kOwnProcess) return EndRequest::make();
    // Both threads stop for good; the other may still process a picture.
    status_.close("vision has failed and stopped: load its nodelet again");
    stop();
    logFatal("%s has failed and stopped; its manager goes on. Load the nodelet again",
             name_.c_str());
  }

  // Thread of the measurements.
  void work() {
    while (const std::optional<Picture> picture = source_.take()) {
      std::string why;
      const bool sound = picture_guard_.run(
          "", [&] { measure(*picture); }, &why);
      if (!sound) {
        status_.enter(VisionStatus::CAMERA_FAULT, "a picture could not be processed: " + why);
      }
      source_.done();
    }
  }

  void measure(const Picture& picture) {
    const CheckedPicture<Measurement> taken = measurer_.measure(picture);
    if (const auto* refusal = std::get_if<PictureRefusal>(&taken)) {
      status_.refuse(*refusal);
    } else {
      publish(std::get<Measurement>(taken));
    }
  }

  void publish(const Measurement& measurement) {
    const std::string camera_frame = options_.cameraFrame();
    const ObservationReport report = reportOf(measurement, frames_.base, camera_frame);
    status_.saw(measurement, report);
    if (report.shape) measured_publisher_.publish(*report.shape);
    if (report.error) error_publisher_.publish(*report.error);
    if (measurement.measured()) {
      const estimation::TwistFit& fit = measurement.observation.fit;
      curve_frames_.send(fit.shape, measurement.stamp, fit.X_B0B);
    }
    detections_publisher_.publish(report.detections);
    const std_msgs::Header header = toHeaderMsg(measurement.stamp, camera_frame);
    if (info_publisher_ && info_publisher_.getNumSubscribers() > 0) {
      info_publisher_.publish(toCameraInfoMsg(header, measurement.view.camera));
    }
    if (image_publisher_) send(image_publisher_, header, [&] { return measurement.gray; });
    const ros::SteadyTime now = ros::SteadyTime::now();
    if (now - last_drawing_ < ros::WallDuration(kDrawingSlack / options_.draw_rate)) return;
    last_drawing_ = now;
    send(overlay_publisher_, header, [&] { return drawOverlay(measurement, report); });
    if (measurement.measured()) status_.drawMarkers(measurement, report.tip);
  }

  /// Publishes a picture while someone subscribes to it.
  template <class MakePicture>
  static void send(const ros::Publisher& publisher, const std_msgs::Header& header,
                   const MakePicture& picture) {
    if (publisher.getNumSubscribers() == 0) return;
    publisher.publish(boost::make_shared<const sensor_msgs::Image>(toImageMsg(header, picture())));
  }

  /// From any thread: ends the threads, and all waits.
  void stop() {
    status_.close();
    source_.stop();
    measurer_.stop();
  }

  /// Stops, and waits for the threads to end.
  void end() {
    stop();
    source_.join();
    worker_.join();
  }

  const Host host_;
  const VisionOptions options_;
  const std::string name_;  ///< of the node
  const FrameNames frames_;

  // Used by callbacks only.
  io::Scene scene_;  ///< the last one loaded
  ros::NodeHandle node_;
  const LoopWatch watched_{node_};
  tf2_ros::StaticTransformBroadcaster static_tf_;

  // A picture passes from source_ through measurer_ to publish().
  VisionStatusPublisher status_;  ///< from any thread
  PictureSource source_;          ///< locks what its threads share
  PictureMeasurer measurer_;      ///< locks what its threads share

  // Used by the thread of the measurements only.
  const ros::Publisher measured_publisher_ = node_.advertise<ArmShape>(names::kMeasured, 10),
                       detections_publisher_ =
                           node_.advertise<TagDetections>(names::kTagDetections, 10),
                       error_publisher_ = node_.advertise<ModelError>(names::kModelError, 10),
                       overlay_publisher_ = node_.advertise<sensor_msgs::Image>(names::kOverlay, 1);
  ros::Publisher image_publisher_, info_publisher_;  ///< only with VisionOptions::publish_image
  CurveFrames curve_frames_{frames_, "pictures are", "them"};
  ros::SteadyTime last_drawing_;
  FaultGuard picture_guard_{"a picture"};

  ros::Subscriber model_subscriber_, estimate_subscriber_;
  std::unique_ptr<ReloadServer> reload_;
  ros::SteadyTimer watch_timer_, second_timer_;
  GuardedThread worker_;  ///< the thread of the measurements
};

}  // namespace

std::unique_ptr<Node> makeVision() {
  return std::make_unique<VisionNode>(ros::NodeHandle(), ros::NodeHandle("~"),
                                      VisionNode::Host::kOwnProcess);
}

std::unique_ptr<Node> makeVisionInManager(const ros::NodeHandle& node,
                                          const ros::NodeHandle& private_node) {
  return std::make_unique<VisionNode>(node, private_node, VisionNode::Host::kManager);
}

}  // namespace helix_arm::ros_bridge
