#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>

#include <ros/node_handle.h>
#include <ros/steady_timer.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/io/scene.hpp"
#include "measurement_publisher.hpp"
#include "picture_measurer.hpp"
#include "picture_source.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/reload_server.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"
#include "vision_options.hpp"
#include "vision_status_publisher.hpp"

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

/// Measures the shape of a scene's arm from pictures of its tags, and compares the model with it.
///
/// Subscribes
/// - image (sensor_msgs/Image; mono8, bgr8, rgb8, bgra8, rgba8, 8-bit Bayer) and image/compressed
///   (sensor_msgs/CompressedImage; JPEG), according to ~source
/// - camera_info (sensor_msgs/CameraInfo): intrinsics in place of the scene's; an uncalibrated one
///   is refused, and nothing is measured until a sound one comes
/// - model (ArmShape): where to expect the tags, and what to compare with
///
/// Publishes
/// - measured (ArmShape, tier `measured`, with covariance): stamped like its picture
/// - tag_detections (TagDetections): of each picture, measured in or not
/// - model_error (ModelError): with each measurement that has a model of its time
/// - vision_status (VisionStatus): at every change of state, and once a second
/// - overlay (sensor_msgs/Image, bgr8): while someone subscribes to it
/// - with ~publish_image: image (sensor_msgs/Image, mono8) and camera_info, the pictures of a
///   webcam or file with the intrinsics that they are measured with: each while someone subscribes
///   to it
/// - measured_markers (visualization_msgs/MarkerArray): see VisionMarkers; deleted when the state
///   is no longer `measured`
/// - /diagnostics (diagnostic_msgs/DiagnosticArray): `<node>: camera`, `<node>: measurement`, 1 Hz
/// - tf: arm_base -> measured_0 .. measured_(n-1) and measured_tip, stamped like the picture;
///   world -> camera_optical (static)
///
/// Service
/// - ~reload (Reload): another file of the same rig, from the next picture on; ~source and the
///   settings of a webcam stay
///
/// Parameters: VisionOptions.
///
/// A picture that comes while one is measured waits; a newer one replaces it, and this is counted.
/// Files are read at the pace of the measurements. A bad picture or camera_info is counted, warned
/// of at a limited rate and reported on vision_status; it never makes a measurement. A picture
/// stamped 0 is stamped on arrival, with a warning. One stamped before the last one is a jump back
/// in time: nothing from before it is used. A steady clock decides whether pictures still come; all
/// else goes by stamps.
///
/// Ends with 0 when asked to, or where ~optional is set and there is nothing to see; 1 when the ROS
/// master is lost; 2 on a bad scene or parameter.
class VisionNode : public Node {
 public:
  /// Whose process it lives in: a fault in its threads ends its own, but not a nodelet manager's.
  enum class Host { kOwnProcess, kManager };

  /// @param node          where topics are relative to.
  /// @param private_node  where parameters are; names the node in diagnostics.
  /// @throws io::DocumentError, ParameterError or std::invalid_argument with every fault found;
  /// NothingToDo.
  VisionNode(const ros::NodeHandle& node, const ros::NodeHandle& private_node, Host host)
      : host_(host),
        options_(VisionOptions::load(private_node)),
        name_(private_node.getNamespace()),
        frames_(options_.world_frame, options_.frame_prefix, names::kMeasuredFrames,
                options_.frames),
        scene_(requireVision(io::loadScene(options_.scene), options_)),
        node_(node),
        status_(node_, options_, name_, frames_.base),
        source_(node_, options_, scene_, status_),
        models_(scene_, status_),
        measurer_(SceneLocalizer(scene_), options_.stale_after, source_, models_),
        publisher_(node_, options_, frames_, status_) {
    sendCameraFrame();
    status_.lookAt(scene_);
    using Self = VisionNode;
    model_subscriber_ = listen(node_, names::kModel, 100, &Self::onModel, this);
    reload_ = std::make_unique<ReloadServer>(private_node, options_.scene, options_.scene_folder,
                                             [this](io::Scene next) { adopt(std::move(next)); });
    watch_timer_ = repeat(node_, "the watch of the pictures", kWatchPeriod, &Self::onWatch, this);
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
    const auto checked = fromMsg(*model, scene_.arm, frames_.base);
    if (const auto* shape = std::get_if<model::Shape>(&checked)) {
      models_.add(model->header.stamp, *shape);
    } else {
      // The picture is measured without the model.
      status_.count({PictureFault::kBadModel, "a model does not match scene " + scene_.name + ": " +
                                                  std::get<control::Refusal>(checked).message});
    }
  }

  void onWatch(const ros::SteadyTimerEvent&) { status_.watch(); }
  void onSecond(const ros::SteadyTimerEvent&) { status_.report(scene_.name); }

  void adopt(io::Scene next) {
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

  void sendCameraFrame() {
    static_tf_.sendTransform(
        worldTransform(frames_.world, options_.cameraFrame(), scene_.camera->X_WC));
  }

  // In the thread that failed.
  void onFailure() {
    if (host_ == Host::kOwnProcess) {
      EndRequest::make();
      return;
    }
    stop();
    // Both threads stop for good; the other may still process a picture.
    status_.fail("vision has failed and stopped: load its nodelet again");
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
      publisher_.publish(std::get<Measurement>(taken));
    }
  }

  /// From any thread: ends the threads, and all waits.
  void stop() {
    status_.stopWatching();
    source_.stop();
    models_.stop();
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
  tf2_ros::StaticTransformBroadcaster static_tf_;

  // A picture passes from source_ through measurer_, which asks models_, to publisher_.
  VisionStatusPublisher status_;    ///< from any thread
  PictureSource source_;            ///< locks what its threads share
  ModelMatcher models_;             ///< locks what its threads share
  PictureMeasurer measurer_;        ///< used by the thread of the measurements, except adopt()
  MeasurementPublisher publisher_;  ///< used by the thread of the measurements only
  FaultGuard picture_guard_{"a picture"};

  ros::Subscriber model_subscriber_;
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
