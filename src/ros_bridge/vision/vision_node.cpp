#include "vision_node.hpp"

#include <optional>
#include <stdexcept>
#include <utility>
#include <variant>

#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr double kWatchPeriod = 0.05;  // [s]

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
  if (options.fromWebcam() && !scene.camera->webcam) {
    throw std::invalid_argument("scene " + scene.name +
                                " has no camera.webcam; add it, or set ~source to topic");
  }
  if (options.publish_image && !options.fromWebcam() && !options.fromFile()) {
    throw std::invalid_argument("~publish_image is true, but the pictures of ~source " +
                                options.source +
                                " come from a topic already; leave it false, or set ~source to "
                                "webcam or a file");
  }
  return scene;
}

}  // namespace

VisionNode::VisionNode(const ros::NodeHandle& node, const ros::NodeHandle& private_node, Host host)
    : host_(host),
      options_(VisionOptions::load(private_node)),
      name_(private_node.getNamespace()),
      frames_(options_.world_frame, options_.frame_prefix, names::kMeasuredFrames, options_.frames),
      scene_(requireVision(io::loadScene(options_.scene), options_)),
      node_(node),
      status_(node_, options_, name_, frames_.base),
      source_(node_, options_, scene_, status_),
      models_(scene_, status_),
      measurer_(SceneLocalizer(scene_), options_.stale_after, source_, models_),
      publisher_(node_, options_, frames_, status_) {
  sendCameraFrame();
  status_.lookAt(scene_);
  using Node = VisionNode;
  model_subscriber_ = listen(node_, names::kModel, 100, &Node::onModel, this);
  reload_ = std::make_unique<ReloadServer>(private_node, options_.scene, options_.scene_folder,
                                           [this](io::Scene next) { adopt(std::move(next)); });
  watch_timer_ = repeat(node_, "the watch of the pictures", kWatchPeriod, &Node::onWatch, this);
  second_timer_ = repeat(node_, "the diagnostics", 1.0, &Node::onSecond, this);
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

VisionNode::~VisionNode() { end(); }

void VisionNode::end() {
  stop();
  source_.join();
  worker_.join();
}

int VisionNode::finish() const {
  return worker_.verdict() != kDone ? worker_.verdict() : source_.verdict();
}

void VisionNode::stop() {
  status_.stopWatching();
  source_.stop();
  models_.stop();
}

void VisionNode::onFailure() {
  if (host_ == Host::kOwnProcess) {
    EndRequest::make();
    return;
  }
  stop();
  // Both threads stop for good; the other may still process a picture.
  status_.fail("vision has failed and stopped: load its nodelet again");
  logFatal("%s has failed and stopped; its manager goes on. Load the nodelet again", name_.c_str());
}

void VisionNode::onModel(const ArmShapeConstPtr& model) {
  const auto checked = fromMsg(*model, scene_.arm, frames_.base);
  if (const auto* shape = std::get_if<model::Shape>(&checked)) {
    models_.add(model->header.stamp, *shape);
  } else {
    // The picture is measured without the model.
    status_.count({PictureFault::kBadModel, "a model does not match scene " + scene_.name + ": " +
                                                std::get<control::Refusal>(checked).message});
  }
}

void VisionNode::onWatch(const ros::SteadyTimerEvent&) { status_.watch(); }

void VisionNode::onSecond(const ros::SteadyTimerEvent&) { status_.report(scene_.name); }

void VisionNode::sendCameraFrame() {
  static_tf_.sendTransform(
      worldTransform(frames_.world, options_.cameraFrame(), scene_.camera->X_WC));
}

void VisionNode::adopt(io::Scene next) {
  VisionOptions asked = options_;
  asked.optional = false;
  next = requireVision(std::move(next), asked);
  requireSameRig(scene_, next);
  SceneLocalizer localizer(next);
  scene_ = std::move(next);
  sendCameraFrame();
  status_.lookAt(scene_);
  measurer_.adopt(std::move(localizer));
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
    publisher_.publish(std::get<Measurement>(taken));
  }
}

}  // namespace helix_arm::ros_bridge
