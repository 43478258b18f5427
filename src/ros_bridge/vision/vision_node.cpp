#include "vision_node.hpp"

#include <stdexcept>
#include <utility>
#include <variant>

#include "helix_arm/basics/requirement.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr double kSilencePeriod = 0.05;  // [s]

// Checks that the scene has a camera and tags, or bodies.
io::Scene requireVision(io::Scene scene, const VisionOptions& options) {
  std::string missing;
  if (options.fromBodies()) {
    if (!scene.hasBodies()) missing = "`bodies`";
  } else {
    if (!scene.camera) missing += "`camera`";
    if (!scene.tags || scene.hasBodies()) missing += missing.empty() ? "`tags`" : " and `tags`";
  }
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

// Publishes a picture while someone subscribes to it.
template <class MakePicture>
void send(const ros::Publisher& publisher, const std_msgs::Header& header,
          const MakePicture& picture) {
  if (publisher.getNumSubscribers() == 0) return;
  publisher.publish(boost::make_shared<const sensor_msgs::Image>(toImageMsg(header, picture())));
}

}  // namespace

VisionNode::VisionNode(const ros::NodeHandle& node, const ros::NodeHandle& private_node, Host host)
    : host_(host),
      options_(private_node),
      name_(private_node.getNamespace()),
      frames_(options_.world_frame, options_.frame_prefix, names::kMeasuredFrames, options_.frames),
      scene_(requireVision(io::loadScene(options_.scene), options_)),
      node_(node),
      status_(node_, name_, frames_.base, options_.source, options_.stale_after,
              1.0 / options_.draw_rate, options_.fromBodies()),
      source_(node_, options_, scene_, status_),
      measurer_(SceneLocalizer(scene_), options_.stale_after, source_, status_) {
  if (options_.fromBodies()) {
    bodies_publisher_ = node_.advertise<BodyPoses>(names::kBodyPoses, 10);
  }
  if (options_.publish_image) {
    image_publisher_ = node_.advertise<sensor_msgs::Image>(names::kImage, 2);
    info_publisher_ = node_.advertise<sensor_msgs::CameraInfo>(names::kCameraInfo, 2);
  }
  sendCameraFrame();
  status_.lookAt(scene_);
  model_subscriber_ = hear(names::kModel, 100, "a model", &PictureMeasurer::addModel);
  estimate_subscriber_ = hear(names::kEstimate, 10, "an estimate", &PictureMeasurer::addEstimate);
  reload_ = std::make_unique<ReloadServer>(private_node, options_.scene, options_.scene_folder,
                                           [this](io::Scene next) { adopt(std::move(next)); });
  watch_timer_ =
      repeat(node_, "the watch of the pictures", kSilencePeriod, [this] { status_.watch(); });
  second_timer_ = repeat(node_, "the diagnostics", 1.0, [this] { status_.report(scene_); });
  const auto on_failure = [this] { onFailure(); };
  try {
    worker_.start([this] { work(); }, on_failure);
    source_.start(on_failure);
  } catch (...) {
    end();  // no destructor runs here, and those of the members wait for their threads
    throw;
  }
  const int count = static_cast<int>(scene_.tags->tags.size());
  const std::string seen = options_.fromBodies()
                               ? " bodies, poses from " + options_.poses.topics
                               : " tags of family " + scene_.vision.detector.family +
                                     ", pictures from " + options_.source;
  logInfo("%s: looks for %d%s", scene_.name.c_str(), count, seen.c_str());
}

int VisionNode::finish() {
  return worker_.verdict() != kDone ? worker_.verdict() : source_.verdict();
}

ros::Subscriber VisionNode::hear(const char* topic, std::uint32_t queue, const char* what,
                                 void (PictureMeasurer::*add)(const ros::Time&,
                                                              const model::Shape&)) {
  return listen<ArmShape>(node_, topic, queue, [this, what, add](const auto& event) {
    const ArmShape& message = *event.getMessage();
    const auto shape = fromMsg(message, scene_.arm, frames_.base);
    if (const auto* refusal = std::get_if<control::Refusal>(&shape)) {
      return status_.count({PictureFault::kBadModel, std::string(what) + " does not match scene " +
                                                         scene_.name + ": " + refusal->message});
    }
    (measurer_.*add)(message.header.stamp, std::get<model::Shape>(shape));
  });
}

void VisionNode::adopt(io::Scene next) {
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

void VisionNode::sendCameraFrame() {
  if (options_.fromBodies()) return;  // the frame of the poses is their sender's
  static_tf_.sendTransform(
      worldTransform(frames_.world, options_.cameraFrame(), scene_.camera->X_WC));
}

void VisionNode::onFailure() {
  if (host_ == Host::kOwnProcess) return EndRequest::make();
  // Both threads stop for good; the other may still process a picture.
  status_.close("vision has failed and stopped: load its nodelet again");
  stop();
  logFatal("%s has failed and stopped; its manager goes on. Load the nodelet again", name_.c_str());
}

void VisionNode::work() {
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

void VisionNode::measure(const Picture& picture) {
  const CheckedPicture<Measurement> taken = measurer_.measure(picture);
  if (const auto* refusal = std::get_if<PictureRefusal>(&taken)) {
    status_.refuse(*refusal);
  } else {
    publish(std::get<Measurement>(taken));
  }
}

void VisionNode::publish(const Measurement& measurement) {
  const bool of_bodies = options_.fromBodies();
  const std::string camera_frame = of_bodies ? measurement.frame : options_.cameraFrame();
  const ObservationReport report = reportOf(measurement, frames_.base, camera_frame);
  status_.saw(measurement, report);
  if (report.shape) {
    measured_publisher_.publish(*report.shape);
    geometry_msgs::PoseStamped tip;
    tip.header = report.shape->header;
    tip.pose = report.shape->tip;
    tip_publisher_.publish(tip);
  }
  if (report.error) error_publisher_.publish(*report.error);
  if (measurement.measured()) {
    const estimation::TwistFit& fit = measurement.observation.fit;
    curve_frames_.send(fit.shape, measurement.stamp, fit.X_B0B);
  }
  detections_publisher_.publish(report.detections);
  if (report.bodies) bodies_publisher_.publish(*report.bodies);
  const std_msgs::Header header = toHeaderMsg(measurement.stamp, camera_frame);
  if (info_publisher_ && info_publisher_.getNumSubscribers() > 0) {
    info_publisher_.publish(toCameraInfoMsg(header, measurement.view.camera));
  }
  if (image_publisher_) send(image_publisher_, header, [&] { return measurement.gray; });
  const ros::SteadyTime now = ros::SteadyTime::now();
  if (now - last_drawing_ < ros::WallDuration(kDrawingSlack / options_.draw_rate)) return;
  last_drawing_ = now;
  if (!of_bodies)
    send(overlay_publisher_, header, [&] { return drawOverlay(measurement, report); });
  if (measurement.measured()) status_.drawMarkers(measurement, report.tip);
}

void VisionNode::stop() {
  status_.close();
  source_.stop();
  measurer_.stop();
}

void VisionNode::end() {
  stop();
  source_.join();
  worker_.join();
}

std::unique_ptr<Node> makeVision() {
  return std::make_unique<VisionNode>(ros::NodeHandle(), ros::NodeHandle("~"),
                                      VisionNode::Host::kOwnProcess);
}

std::unique_ptr<Node> makeVisionInManager(const ros::NodeHandle& node,
                                          const ros::NodeHandle& private_node) {
  return std::make_unique<VisionNode>(node, private_node, VisionNode::Host::kManager);
}

}  // namespace helix_arm::ros_bridge
