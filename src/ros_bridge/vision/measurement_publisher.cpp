#include "ros_bridge/vision/measurement_publisher.hpp"

#include <utility>

#include <boost/make_shared.hpp>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/names.hpp"
#include "ros_bridge/vision/overlay.hpp"
#include "ros_bridge/vision/pictures.hpp"

namespace helix_arm::ros_bridge {
namespace {

// Pictures are not exactly periodic; one slightly early must not be skipped.
constexpr double kDrawingSlack = 0.9;

}  // namespace

MeasurementPublisher::MeasurementPublisher(ros::NodeHandle& node, const VisionOptions& options,
                                           FrameNames frames, VisionStatusPublisher& status)
    : frames_(std::move(frames)),
      camera_frame_(options.cameraFrame()),
      drawing_period_(kDrawingSlack / options.draw_rate),
      status_(status),
      measured_publisher_(node.advertise<ArmShape>(names::kMeasured, 10)),
      detections_publisher_(node.advertise<TagDetections>(names::kTagDetections, 10)),
      error_publisher_(node.advertise<ModelError>(names::kModelError, 10)),
      overlay_publisher_(node.advertise<sensor_msgs::Image>(names::kOverlay, 1)) {
  if (!options.publish_image) return;
  image_publisher_ = node.advertise<sensor_msgs::Image>(names::kImage, 2);
  info_publisher_ = node.advertise<sensor_msgs::CameraInfo>(names::kCameraInfo, 2);
}

void MeasurementPublisher::publish(const Measurement& measurement) {
  const ObservationReport report = reportOf(measurement, frames_.base, camera_frame_);
  status_.saw(measurement, report);
  if (report.shape) measured_publisher_.publish(*report.shape);
  if (report.error) error_publisher_.publish(*report.error);
  if (measurement.measured()) sendFrames(measurement);
  detections_publisher_.publish(report.detections);
  republish(measurement);
  draw(measurement, report);
}

void MeasurementPublisher::republish(const Measurement& measurement) {
  std_msgs::Header header;
  header.stamp = measurement.stamp;
  header.frame_id = camera_frame_;
  if (info_publisher_ && info_publisher_.getNumSubscribers() > 0) {
    info_publisher_.publish(toCameraInfoMsg(header, measurement.view.camera));
  }
  if (image_publisher_ && image_publisher_.getNumSubscribers() > 0) {
    image_publisher_.publish(
        boost::make_shared<const sensor_msgs::Image>(toImageMsg(header, measurement.gray)));
  }
}

void MeasurementPublisher::sendFrames(const Measurement& measurement) {
  const ros::Time& stamp = measurement.stamp;
  if (endsTf(stamp)) {
    if (far_stamps_.add()) {
      logWarning(
          "pictures are stamped %.1f s ahead of ROS time (%lu times so far): no tf is published "
          "for them; synchronise the clocks",
          secondsBetween(ros::Time::now(), stamp), static_cast<unsigned long>(far_stamps_.total()));
    }
    return;
  }
  // tf warns of repeated stamps, except after a jump back in time.
  if (stamp < last_stamp_) last_tf_stamp_ = ros::Time();
  last_stamp_ = stamp;
  if (stamp == last_tf_stamp_) return;
  const estimation::TwistFit& fit = measurement.observation.fit;
  tf_.sendTransform(curveTransforms(frames_, fit.shape, stamp, fit.X_B0B));
  last_tf_stamp_ = stamp;
}

void MeasurementPublisher::draw(const Measurement& measurement, const ObservationReport& report) {
  const ros::SteadyTime now = ros::SteadyTime::now();
  if (now - last_drawing_ < drawing_period_) return;
  last_drawing_ = now;
  if (overlay_publisher_.getNumSubscribers() > 0) {
    overlay_publisher_.publish(boost::make_shared<const sensor_msgs::Image>(
        toImageMsg(report.detections.header, drawOverlay(measurement, report))));
  }
  if (measurement.measured()) status_.drawMarkers(measurement, report.tip);
}

}  // namespace helix_arm::ros_bridge
