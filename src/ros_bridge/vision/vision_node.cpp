#include "helix_arm/ros_bridge/vision/vision_node.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/console.h>

#include "helix_arm/ros_bridge/common/conversions.hpp"
#include "helix_arm/ros_bridge/common/file_access.hpp"
#include "helix_arm/ros_bridge/common/names.hpp"
#include "helix_arm/ros_bridge/common/parameters.hpp"
#include "helix_arm/ros_bridge/vision/overlay.hpp"
#include "helix_arm/ros_bridge/vision/sights.hpp"

namespace helix_arm::ros_bridge {
namespace {

// A picture waits so long for the model of its time: with pressures at 100 Hz and more it is there
// by then, and a replay meets the same model as the first time.
constexpr std::chrono::milliseconds kModelPatience(100);
// Each wait in vain halves the patience, down to this: models that always lag must not slow the
// pictures down.
constexpr std::chrono::milliseconds kLeastPatience(5);
constexpr std::chrono::milliseconds kFaultPause(50);  // between faults of a source
constexpr double kLongestPause = 3600.0;              // between tries of a webcam [s]
constexpr double kWatchPeriod = 0.05;                 // [s]
// Pictures are not quite even in time: one at the wanted rate is not to be left out for that.
constexpr double kDrawingSlack = 0.9;

constexpr char kTopic[] = "topic";
constexpr char kWebcam[] = "webcam";

bool isFile(const std::string& source) { return source.compare(0, 1, "/") == 0; }

// The scene, when there is something to see in it.
io::Scene requireSight(io::Scene scene, const VisionOptions& options) {
  std::string missing;
  if (!scene.camera) missing += "`camera`";
  if (!scene.tags) missing += missing.empty() ? "`tags`" : " and `tags`";
  if (!missing.empty()) {
    const std::string message = "scene " + scene.name + " has no " + missing + ": nothing to see";
    if (options.optional) throw NothingToDo(message);
    throw std::invalid_argument(message + "; add what is missing to it");
  }
  if (options.source == kWebcam && !scene.camera->webcam) {
    throw std::invalid_argument("scene " + scene.name +
                                " has no camera.webcam; add it, or set ~source to topic");
  }
  return scene;
}

std::unique_ptr<vision::FrameSource> makeSource(const VisionOptions& options,
                                                const io::Scene& scene) {
  if (options.source == kWebcam) return vision::FrameSource::webcam(*scene.camera->webcam);
  if (isFile(options.source)) return vision::FrameSource::files(options.source);
  return nullptr;
}

// What to expect before a model comes.
model::Shape restingShape(const io::Scene& scene) {
  const Eigen::VectorXd rest = scene.arm.inputAt(0);
  const statics::Solution solution = scene.model.solve(rest);
  if (!solution.converged()) {
    ROS_WARN(
        "%s: the model finds no shape of the resting arm (%s, residual %.2g): tags are looked for "
        "where they are without load until a model comes",
        scene.name.c_str(), statics::nameOf(solution.status), solution.residual);
  }
  return statics::startingShape(scene.model, solution, rest);
}

std::uint8_t stateOf(vision::SightState state) {
  switch (state) {
    case vision::SightState::kMeasured:
      return VisionStatus::MEASURED;
    case vision::SightState::kTooFewTags:
      return VisionStatus::FEW_TAGS;
    case vision::SightState::kNoTags:
      return VisionStatus::NO_TAGS;
    case vision::SightState::kNoFit:
      break;
  }
  return VisionStatus::NO_FIT;
}

std::string tipText(const estimation::TwistFit& fit, const ModelError* error) {
  if (error == nullptr) return "tip +- " + fixed(1e3 * tipSigma(fit)) + " mm";
  return "model off by " + fixed(1e3 * error->tip_error) + " mm (" + fixed(error->tip_percent) +
         " %)";
}

}  // namespace

VisionOptions VisionOptions::load(const ros::NodeHandle& private_node) {
  ParameterReader reader(private_node);
  VisionOptions out;
  out.scene = reader.file("scene", "config/scenes", ".yaml");
  out.source = reader.text("source", out.source);
  if (!isFile(out.source)) {
    out.source = reader.choice(
        "source", out.source,
        {kTopic, names::kImage, names::kCompressedImage, kWebcam, "an absolute path"});
  }
  out.use_camera_info = reader.flag("use_camera_info", out.use_camera_info);
  out.camera_info_url = reader.text("camera_info_url", "");
  out.file_rate = reader.number("file_rate", out.file_rate, {0.1, 1000.0});
  out.draw_rate = reader.number("draw_rate", out.draw_rate, {0.1, 100.0});
  out.stale_after = reader.number("stale_after_s", out.stale_after, {0.05, 60.0});
  out.frames = reader.count("frames", out.frames, 2, 1000);
  out.world_frame = reader.frame("world_frame", names::kWorldFrame);
  out.frame_prefix = reader.frame("frame_prefix", "");
  out.optional = reader.flag("optional", out.optional);
  out.scene_folder = reader.folder("scene_folder", defaultFolder());
  reader.finish();
  return out;
}

VisionNode::VisionNode(const ros::NodeHandle& node, const ros::NodeHandle& private_node, Host host)
    : host_(host),
      options_(VisionOptions::load(private_node)),
      name_(private_node.getNamespace()),
      frames_(options_.world_frame, options_.frame_prefix, names::kMeasuredFrames, options_.frames),
      markers_(frames_.base, std::max(1.0, 3.0 / options_.draw_rate)),
      rig_(requireSight(io::loadScene(options_.scene), options_)),
      eyes_{rig_, std::make_unique<vision::ArmLocalizer>(rig_.view(), rig_.vision)},
      prior_(restingShape(rig_)),
      whose_calibration_("the scene's camera"),
      patience_(kModelPatience),
      source_(makeSource(options_, rig_)),
      ledger_(options_.source),
      lease_(options_.stale_after),
      last_arrival_(ros::SteadyTime::now()),
      last_report_(last_arrival_),
      node_(node) {
  if (source_ == nullptr && !options_.camera_info_url.empty()) {
    throw std::invalid_argument("~camera_info_url is " + options_.camera_info_url +
                                ", but the calibration of ~source " + options_.source +
                                " comes on camera_info; leave ~camera_info_url empty, or set "
                                "~source to webcam or a file");
  }
  ledger_.calibrated(whose_calibration_);
  measured_publisher_ = node_.advertise<ArmShape>(names::kMeasured, 10);
  detections_publisher_ = node_.advertise<TagDetections>(names::kTagDetections, 10);
  error_publisher_ = node_.advertise<ModelError>(names::kModelError, 10);
  status_publisher_ = node_.advertise<VisionStatus>(names::kVisionStatus, 10);
  overlay_publisher_ = node_.advertise<sensor_msgs::Image>(names::kOverlay, 1);
  marker_publisher_ = node_.advertise<visualization_msgs::MarkerArray>(names::kMeasuredMarkers, 2);
  diagnostics_publisher_ =
      node_.advertise<diagnostic_msgs::DiagnosticArray>(names::kDiagnostics, 10);
  static_tf_.sendTransform(worldTransform(
      frames_.world, options_.frame_prefix + names::kCameraFrame, rig_.camera->X_WC));

  using Node = VisionNode;
  const bool any = options_.source == kTopic;
  if (any || options_.source == names::kImage) {
    image_subscriber_ = listen(node_, names::kImage, 1, &Node::onImage, this);
  }
  if (any || options_.source == names::kCompressedImage) {
    compressed_subscriber_ = listen(node_, names::kCompressedImage, 1, &Node::onCompressed, this);
  }
  if (source_ == nullptr && options_.use_camera_info) {
    info_subscriber_ = listen(node_, names::kCameraInfo, 1, &Node::onCameraInfo, this);
  }
  if (source_ != nullptr && !options_.camera_info_url.empty()) {
    calibration_ = std::make_unique<camera_info_manager::CameraInfoManager>(
        node_, "camera", options_.camera_info_url);
    if (!calibration_->isCalibrated()) {
      throw std::invalid_argument("~camera_info_url is " + options_.camera_info_url +
                                  "; expected the URL of a calibration");
    }
  }
  model_subscriber_ = listen(node_, names::kModel, 100, &Node::onModel, this);
  reload_ = std::make_unique<ReloadServer>(private_node, options_.scene, options_.scene_folder,
                                           [this](io::Scene next) { adopt(std::move(next)); });
  watch_timer_ = repeat(node_, "the watch of the pictures", kWatchPeriod, &Node::onWatch, this);
  second_timer_ = repeat(node_, "the diagnostics", 1.0, &Node::onSecond, this);
  const auto on_failure = [this] { onFailure(); };
  worker_.start([this] { work(); }, on_failure);
  if (source_ != nullptr) capturer_.start([this] { capture(); }, on_failure);
  ROS_INFO("%s: looks for %d tags of family %s, pictures from %s", rig_.name.c_str(),
           static_cast<int>(rig_.tags->tags.size()), rig_.vision.detector.family.c_str(),
           options_.source.c_str());
}

VisionNode::~VisionNode() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  capturer_.join();
  worker_.join();
}

int VisionNode::finish() const {
  return worker_.verdict() != kDone ? worker_.verdict() : capturer_.verdict();
}

void VisionNode::onFailure() {
  if (host_ == Host::kOwnProcess) {
    EndRequest::make();
    return;
  }
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    enter(VisionStatus::CAMERA_FAULT, "vision has failed and stopped: load its nodelet again");
    stop_ = true;
  }
  wake_.notify_all();
  ROS_FATAL("%s has failed and stopped; its manager goes on. Load the nodelet again",
            name_.c_str());
}

template <class Message>
void VisionNode::onPicture(const boost::shared_ptr<const Message>& picture, const char* topic) {
  ros::Time stamp = picture->header.stamp;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!lease_.claim(topic, ros::SteadyTime::now().toSec())) return;
    if (stamp.isZero()) {
      stamp = ros::Time::now();
      if (unstamped_.add()) {
        ROS_WARN(
            "pictures on %s have no stamp (%lu so far): stamped on arrival, later than they "
            "were taken; let the camera's node stamp them",
            topic, static_cast<unsigned long>(unstamped_.total()));
      }
    }
  }
  arrived({stamp, picture});
}

void VisionNode::onImage(const sensor_msgs::ImageConstPtr& image) {
  onPicture(image, names::kImage);
}

void VisionNode::onCompressed(const sensor_msgs::CompressedImageConstPtr& image) {
  onPicture(image, names::kCompressedImage);
}

void VisionNode::onCameraInfo(const sensor_msgs::CameraInfoConstPtr& info) {
  const std::lock_guard<std::mutex> lock(mutex_);
  camera_info_ = fromMsg(*info);
  // Only counted here: the state follows from the pictures.
  if (const auto* refusal = std::get_if<PictureRefusal>(&*camera_info_)) ledger_.refused(*refusal);
}

void VisionNode::onModel(const ArmShapeConstPtr& model) {
  const auto checked = fromMsg(*model, rig_.arm.sectionCount(), frames_.base);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (const auto* shape = std::get_if<model::Shape>(&checked)) {
      models_.add(model->header.stamp, *shape);
    } else {
      // Measured without it, all the same.
      ledger_.refused({PictureFault::kBadModel, "a model is not taken for scene " + rig_.name +
                                                    ": " +
                                                    std::get<control::Refusal>(checked).message});
    }
  }
  wake_.notify_all();
}

void VisionNode::onWatch(const ros::SteadyTimerEvent&) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const double silence = (ros::SteadyTime::now() - last_arrival_).toSec();
  if (stop_ || silence < options_.stale_after || ledger_.state() == VisionStatus::ENDED) return;
  if (ledger_.status().pictures == 0 || source_fault_) return;
  enter(VisionStatus::STALE, "no picture has come for " + fixed(silence) +
                                 " s: is the camera plugged in, and its node up?");
}

void VisionNode::onSecond(const ros::SteadyTimerEvent&) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const ros::SteadyTime now = ros::SteadyTime::now();
  diagnostic_msgs::DiagnosticArray msg;
  msg.header.stamp = ros::Time::now();
  msg.status.resize(2);
  msg.status[0].name = statusName(name_, names::kCameraStatus);
  msg.status[1].name = statusName(name_, names::kMeasurementStatus);
  for (auto& status : msg.status) status.hardware_id = rig_.name;
  ledger_.report(msg.status[0], msg.status[1], (now - last_report_).toSec());
  last_report_ = now;
  diagnostics_publisher_.publish(msg);
  publishStatus();
}

void VisionNode::adopt(io::Scene next) {
  VisionOptions asked = options_;
  asked.optional = false;
  next = requireSight(std::move(next), asked);
  requireSameRig(rig_, next);
  Eyes eyes{next, std::make_unique<vision::ArmLocalizer>(next.view(), next.vision)};
  rig_ = std::move(next);
  static_tf_.sendTransform(worldTransform(
      frames_.world, options_.frame_prefix + names::kCameraFrame, rig_.camera->X_WC));
  const std::lock_guard<std::mutex> lock(mutex_);
  next_eyes_ = std::move(eyes);
}

void VisionNode::capture() {
  const bool file = isFile(options_.source);
  const auto period = std::chrono::duration_cast<std::chrono::steady_clock::duration>(
      std::chrono::duration<double>(1.0 / options_.file_rate));
  vision::Frame frame;
  const auto waitUntil = [this](const auto& due, const auto& condition) {
    std::unique_lock<std::mutex> lock(mutex_);
    wake_.wait_until(lock, due, [&] { return stop_ || condition(); });
    return !stop_;
  };
  const auto never = [] { return false; };
  for (bool go_on = true; go_on;) {
    const auto due = std::chrono::steady_clock::now() + period;
    const vision::FrameStatus status = source_->next(frame);
    if (status == vision::FrameStatus::kEnd) {
      const std::lock_guard<std::mutex> lock(mutex_);
      enter(VisionStatus::ENDED, options_.source + " is through");
      return;
    }
    if (status == vision::FrameStatus::kFault) {
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        source_fault_ = true;
        refuse({PictureFault::kSource, frame.fault});
      }
      const auto pause =
          std::max(std::chrono::duration<double>(kFaultPause),
                   std::chrono::duration<double>(std::min(frame.retry_after, kLongestPause)));
      go_on = waitUntil(std::chrono::steady_clock::now() +
                            std::chrono::duration_cast<std::chrono::steady_clock::duration>(pause),
                        never);
      continue;
    }
    if (calibration_ != nullptr) {
      const auto camera = fromMsg(calibration_->getCameraInfo());
      const std::lock_guard<std::mutex> lock(mutex_);
      camera_info_ = camera;
    }
    // The source uses its memory again for the next picture.
    arrived({ros::Time::now(), frame.gray.clone()});
    if (file) {
      go_on = waitUntil(due, never);
      std::unique_lock<std::mutex> lock(mutex_);
      wake_.wait(lock, [this] { return stop_ || (!next_ && !busy_); });
    }
    const std::lock_guard<std::mutex> lock(mutex_);
    go_on = !stop_;
  }
}

void VisionNode::arrived(Picture picture) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (stop_) return;
    last_arrival_ = ros::SteadyTime::now();
    source_fault_ = false;
    ledger_.picture();
    if (next_) ledger_.skipped();
    next_ = std::move(picture);
  }
  wake_.notify_all();
}

void VisionNode::work() {
  while (true) {
    std::optional<Picture> picture;
    {
      std::unique_lock<std::mutex> lock(mutex_);
      wake_.wait(lock, [this] { return stop_ || next_; });
      if (stop_) return;
      std::swap(picture, next_);
      if (next_eyes_) eyes_ = std::move(*next_eyes_);
      next_eyes_.reset();
      busy_ = true;
    }
    std::string why;
    const bool sound = picture_guard_.run(
        "", [&] { measure(*picture); }, &why);
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      if (!sound) enter(VisionStatus::CAMERA_FAULT, "a picture cannot be measured in: " + why);
      busy_ = false;
    }
    wake_.notify_all();
  }
}

Taken<cv::Mat> VisionNode::decode(const Picture& picture) {
  if (const auto* raw = std::get_if<sensor_msgs::ImageConstPtr>(&picture.content)) {
    return fromMsg(**raw, buffer_);
  }
  if (const auto* jpeg = std::get_if<sensor_msgs::CompressedImageConstPtr>(&picture.content)) {
    return fromMsg(**jpeg, decoder_, buffer_);
  }
  return std::get<cv::Mat>(picture.content);
}

std::optional<PictureRefusal> VisionNode::adoptCamera(const cv::Size& size) {
  estimation::ArmView view = eyes_.localizer->view();
  const char* whose = "the scene's camera";
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (camera_info_) {
      if (const auto* refusal = std::get_if<PictureRefusal>(&*camera_info_)) return *refusal;
      view.camera = std::get<estimation::Camera>(*camera_info_);
      whose = "camera_info";
    }
  }
  if (size != cv::Size(view.camera.width, view.camera.height)) {
    return PictureRefusal{PictureFault::kWrongSize,
                          "the picture is of " + sizeText(size.width, size.height) +
                              " pixels, but " + whose + " of " +
                              sizeText(view.camera.width, view.camera.height) +
                              "; a calibration holds for one size only"};
  }
  if (!equal(view.camera, eyes_.localizer->view().camera)) {
    if (adoptions_.add()) {
      ROS_INFO(
          "camera_info differs from the intrinsics at hand (%lu times so far): going by "
          "camera_info%s",
          static_cast<unsigned long>(adoptions_.total()),
          info_subscriber_.getNumPublishers() > 1
              ? "; more than one node publishes it: stop all but the camera's"
              : "");
    }
    eyes_.localizer = std::make_unique<vision::ArmLocalizer>(view, eyes_.scene.vision);
  }
  whose_calibration_ = whose;
  return std::nullopt;
}

std::uint32_t VisionNode::publishers() const {
  return std::max(image_subscriber_.getNumPublishers(), compressed_subscriber_.getNumPublishers());
}

std::optional<ModelHistory::Entry> VisionNode::modelAt(const ros::Time& stamp) {
  std::unique_lock<std::mutex> lock(mutex_);
  const std::optional<double> ahead = models_.lag(stamp);
  models_.forgetFuture(stamp);
  const bool waits = models_.mayGetNearer(stamp);
  const bool in_time =
      wake_.wait_for(lock, patience_, [&] { return stop_ || !models_.mayGetNearer(stamp); });
  if (!in_time) {
    patience_ = std::max(kLeastPatience, patience_ / 2);
  } else if (waits) {
    patience_ = std::min(kModelPatience, 2 * patience_);
  }
  const std::optional<double> lag = models_.lag(stamp) ? models_.lag(stamp) : ahead;
  ledger_.modelLag(lag);
  if (lag && (!in_time || std::abs(*lag) > ModelHistory::kReach) && late_models_.add()) {
    ROS_WARN(
        "models are stamped %.3f s %s the pictures (%lu times so far): is the models' node "
        "up, and are the clocks of the camera's and the arm's computers synchronised? Where no "
        "shape holds the scene's load it gives no model: see `%s` in its diagnostics",
        std::abs(*lag), *lag < 0 ? "after" : "before",
        static_cast<unsigned long>(late_models_.total()), names::kModelStatus);
  }
  return models_.nearest(stamp);
}

Taken<cv::Mat> VisionNode::take(const Picture& picture) {
  // What is not of the camera's size is not worth decoding, which may take long.
  if (const auto* jpeg = std::get_if<sensor_msgs::CompressedImageConstPtr>(&picture.content)) {
    const auto& data = (*jpeg)->data;
    const cv::Size claimed = vision::JpegDecoder::claimedSize(data.data(), data.size());
    if (!claimed.empty()) {
      if (auto refusal = adoptCamera(claimed)) return std::move(*refusal);
    }
  }
  Taken<cv::Mat> taken = decode(picture);
  if (const auto* gray = std::get_if<cv::Mat>(&taken)) {
    if (auto refusal = adoptCamera(gray->size())) return std::move(*refusal);
  }
  return taken;
}

void VisionNode::measure(const Picture& picture) {
  const Taken<cv::Mat> taken = take(picture);
  const auto* gray = std::get_if<cv::Mat>(&taken);
  if (gray == nullptr) {
    const auto& refusal = std::get<PictureRefusal>(taken);
    const bool counted = refusal.fault == PictureFault::kBadCameraInfo;  // when it came
    const std::lock_guard<std::mutex> lock(mutex_);
    if (counted) {
      enter(VisionStatus::CAMERA_FAULT, refusal.message);
    } else {
      refuse(refusal);
    }
    return;
  }
  const double elapsed = secondsBetween(last_stamp_, picture.stamp);
  if (elapsed < 0 || elapsed > options_.stale_after) eyes_.localizer->reset();
  if (elapsed < 0) {
    if (jumps_.add()) {
      ROS_INFO("the pictures' time has jumped back by %.1f s (%lu times so far): starting anew%s",
               -elapsed, static_cast<unsigned long>(jumps_.total()),
               publishers() > 1 ? "; more than one node publishes pictures: stop all but one" : "");
    }
    prior_ = restingShape(eyes_.scene);
    last_tf_stamp_ = ros::Time();
  }
  last_stamp_ = picture.stamp;
  const std::optional<ModelHistory::Entry> model = modelAt(picture.stamp);
  if (model) prior_ = model->shape;
  publish(picture.stamp, *gray, eyes_.localizer->locate(*gray, prior_), model);
}

void VisionNode::publish(const ros::Time& stamp, const cv::Mat& gray, const vision::Sight& sight,
                         const std::optional<ModelHistory::Entry>& model) {
  const estimation::TagLayout& layout = eyes_.localizer->view().layout;
  const bool measured = sight.state == vision::SightState::kMeasured;
  std_msgs::Header header;
  header.stamp = stamp;
  header.frame_id = frames_.base;
  std_msgs::Header camera_header = header;
  camera_header.frame_id = options_.frame_prefix + names::kCameraFrame;

  const std::string account = describe(sight, eyes_.scene.vision);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ledger_.saw(sight);
    ledger_.calibrated(whose_calibration_);
    enter(stateOf(sight.state), account + "; calibration: " + whose_calibration_);
  }
  std::optional<ModelError> error;
  if (measured) {
    measured_publisher_.publish(
        toShapeMsg(header, "measured", sight.fit.shape, sight.fit.covariance));
    if (model) error_publisher_.publish(error.emplace(toMsg(header, sight.fit, *model)));
    // tf warns of repeated stamps.
    if (endsTf(stamp)) {
      if (far_stamps_.add()) {
        ROS_WARN(
            "pictures are stamped %.1f s ahead of ROS time (%lu times so far): no frames are given "
            "for them; set the clocks alike",
            secondsBetween(ros::Time::now(), stamp),
            static_cast<unsigned long>(far_stamps_.total()));
      }
    } else if (stamp > last_tf_stamp_) {
      tf_.sendTransform(curveTransforms(frames_, sight.fit.shape, stamp, sight.fit.X_B0B));
      last_tf_stamp_ = stamp;
    }
  }
  detections_publisher_.publish(toMsg(camera_header, sight, layout));

  const ros::SteadyTime now = ros::SteadyTime::now();
  if (now - last_drawing_ < ros::WallDuration(kDrawingSlack / options_.draw_rate)) return;
  last_drawing_ = now;
  const std::string tip = measured ? tipText(sight.fit, error ? &*error : nullptr) : "";
  const model::Shape* shape = model ? &model->shape : nullptr;
  if (overlay_publisher_.getNumSubscribers() > 0) {
    const std::vector<std::string> lines = measured
                                               ? std::vector<std::string>{tip, summarise(sight)}
                                               : std::vector<std::string>{account};
    overlay_publisher_.publish(boost::make_shared<const sensor_msgs::Image>(toImageMsg(
        camera_header, drawOverlay(gray, eyes_.localizer->view(), sight, shape, lines))));
  }
  // What has become stale meanwhile was taken off the screen, and stays off.
  const std::lock_guard<std::mutex> lock(mutex_);
  if (measured && ledger_.measured()) {
    marker_publisher_.publish(markers_.draw(stamp, layout, sight.fit, shape, tip));
  }
}

void VisionNode::refuse(const PictureRefusal& refusal) {
  ledger_.refused(refusal);
  enter(VisionStatus::CAMERA_FAULT, refusal.message);
}

void VisionNode::enter(std::uint8_t state, const std::string& message) {
  const bool was_measured = ledger_.measured();
  const bool changed = ledger_.enter(state, message);
  if (changed) publishStatus();
  if (changed && was_measured) marker_publisher_.publish(markers_.remove(ros::Time::now()));
}

void VisionNode::publishStatus() {
  VisionStatus status = ledger_.status();
  status.header.stamp = ros::Time::now();
  status_publisher_.publish(status);
}

}  // namespace helix_arm::ros_bridge
