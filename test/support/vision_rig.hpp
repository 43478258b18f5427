#pragma once

#include <cmath>

#include <visualization_msgs/MarkerArray.h>

#include "helix_arm/ModelError.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/VisionStatus.h"
#include "helix_arm/io/scene.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/vision/pictures.hpp"
#include "simulation/camera.hpp"
#include "support/ros_rig.hpp"
#include "support/shipped_scene.hpp"

namespace helix_arm::test {

inline Eigen::VectorXd vectorOf(const std::vector<double>& values) {
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

/// What one vision node publishes.
struct VisionListener {
  explicit VisionListener(const std::string& ns)
      : node(ns),
        measured(node, names::kMeasured),
        detections(node, names::kTagDetections),
        errors(node, names::kModelError),
        status(node, names::kVisionStatus),
        markers(node, names::kMeasuredMarkers) {}

  ros::NodeHandle node;
  Inbox<ArmShape> measured;
  Inbox<TagDetections> detections;
  Inbox<ModelError> errors;
  Inbox<VisionStatus> status;
  Inbox<visualization_msgs::MarkerArray> markers;

  /// Waits for a status like this; null when none came.
  VisionStatus::ConstPtr tells(const std::function<bool(const VisionStatus&)>& predicate) {
    return status.next(predicate);
  }

  /// Waits for a message with this stamp, which may have come already; null when none came.
  template <class Message>
  static typename Message::ConstPtr of(const Inbox<Message>& inbox, const ros::Time& stamp,
                                       double deadline = 60.0) {
    typename Message::ConstPtr found;
    waitFor(
        [&] {
          for (const auto& message : inbox.all()) {
            if (message->header.stamp == stamp) found = message;
          }
          return found != nullptr;
        },
        deadline);
    return found;
  }
};

/// The camera of one vision node on the demo scene: shows it pictures, and reads the answers.
class CameraStandIn : public VisionListener {
 public:
  explicit CameraStandIn(const std::string& ns)
      : VisionListener(ns),
        scene(demo()),
        camera_(scene.view(), vision::TagFamily(scene.vision.detector.family), {},
                scene.simulation.camera),
        encoder_(90),
        image_(node.advertise<sensor_msgs::Image>(names::kImage, 10)),
        compressed_(node.advertise<sensor_msgs::CompressedImage>(names::kCompressedImage, 10)),
        info_(node.advertise<sensor_msgs::CameraInfo>(names::kCameraInfo, 10)),
        model_(node.advertise<ArmShape>(names::kModel, 10)) {}

  const io::Scene scene;

  /// True when the node listens and is listened to.
  bool connect() {
    return waitFor([this] {
      return image_.getNumSubscribers() + compressed_.getNumSubscribers() > 0 &&
             info_.getNumSubscribers() > 0 && model_.getNumSubscribers() > 0 &&
             measured.publishers() > 0 && markers.publishers() > 0 && !status.all().empty();
    });
  }

  model::Twists twists(const std::vector<double>& pressure) const {
    return scene.arm.twists(vectorOf(pressure));
  }
  cv::Mat picture(const model::Twists& shape) { return camera_.render(shape).clone(); }

  /// A stamp of its own for each message.
  ros::Time stamp() {
    last_stamp_ = std::max(ros::Time::now(), last_stamp_ + ros::Duration(0.001));
    return last_stamp_;
  }

  sensor_msgs::CompressedImage jpeg(const cv::Mat& gray, const ros::Time& at) {
    sensor_msgs::CompressedImage message;
    message.header.stamp = at;
    message.format = "jpeg";
    message.data = encoder_.encode(gray);
    return message;
  }
  sensor_msgs::Image raw(const cv::Mat& gray, const ros::Time& at) const {
    std_msgs::Header header;
    header.stamp = at;
    return ros_bridge::toImageMsg(header, gray);
  }
  sensor_msgs::CameraInfo info() const {
    return ros_bridge::toCameraInfoMsg({}, scene.camera->model);
  }

  void publish(const sensor_msgs::CompressedImage& message) { compressed_.publish(message); }
  void publish(const sensor_msgs::Image& message) { image_.publish(message); }
  void publish(const sensor_msgs::CameraInfo& message) { info_.publish(message); }
  void publish(const ArmShape& message) { model_.publish(message); }

  /// Shows a picture on whatever topic the node listens to.
  void show(const cv::Mat& gray, const ros::Time& at) {
    if (compressed_.getNumSubscribers() > 0) {
      publish(jpeg(gray, at));
    } else {
      publish(raw(gray, at));
    }
  }

 private:
  simulation::SimulatedCamera camera_;
  vision::JpegEncoder encoder_;
  ros::Time last_stamp_;
  ros::Publisher image_, compressed_, info_, model_;
};

}  // namespace helix_arm::test
