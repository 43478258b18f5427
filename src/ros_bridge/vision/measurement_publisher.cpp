#include "measurement_publisher.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <boost/make_shared.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include "helix_arm/model/curve.hpp"
#include "observations.hpp"
#include "pictures.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

/// Draws over a picture what was seen in it.
///
/// Tags are outlined, with their ids: green, red where they do not fit, grey where they are not the
/// arm's or seen twice. The measured curve is solid, the model's dashed. The report's lines of text
/// are in the upper left corner.
/// @return (CV_8UC3), BGR.
cv::Mat drawOverlay(const Measurement& measurement, const ObservationReport& report);

namespace {

constexpr int kPoints = 48;  // of a curve, per section; even, since dashes are drawn in pairs
constexpr double kTextShare = 0.45;  // of the picture's width: an arm in its middle stays in sight
constexpr int kShift = 4;            // OpenCV's fixed point: sixteenths of a pixel

const cv::Scalar kFits(90, 230, 90), kDoesNotFit(50, 60, 255), kNotUsed(170, 170, 170);
const cv::Scalar kMeasured(30, 140, 255), kModel(100, 240, 255), kDark(30, 30, 30);

// Sizes of lines and letters that stay legible if the picture is shown much smaller.
struct Pen {
  cv::Mat& picture;
  int width;
  double letter;

  explicit Pen(cv::Mat& on)
      : picture(on), width(std::max(1, on.cols / 400)), letter(std::max(0.4, on.cols / 640.0)) {}

  static cv::Point fine(const Eigen::Vector2d& p) {
    constexpr double kFar = 1e5;  // [px]; fixed point overflows beyond
    const double unit = 1 << kShift;
    return {static_cast<int>(std::lround(unit * std::clamp(p.x(), -kFar, kFar))),
            static_cast<int>(std::lround(unit * std::clamp(p.y(), -kFar, kFar)))};
  }
  void line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const cv::Scalar& color) const {
    cv::line(picture, fine(a), fine(b), color, width, cv::LINE_AA, kShift);
  }
  void text(const std::string& words, cv::Point place, double size, const cv::Scalar& color) const {
    const auto put = [&](const cv::Scalar& ink, int thickness) {
      cv::putText(picture, words, place, cv::FONT_HERSHEY_SIMPLEX, size, ink, thickness,
                  cv::LINE_AA);
    };
    put(kDark, 2 * width + 4);
    put(color, width + 1);
  }

  // Lines of whole words, none wider than this unless a word is [px].
  std::vector<std::string> wrapped(const std::string& words, double widest) const {
    std::vector<std::string> lines(1);
    std::istringstream rest(words);
    for (std::string word; rest >> word;) {
      std::string& line = lines.back();
      const std::string longer = line.empty() ? word : line + " " + word;
      const cv::Size size =
          cv::getTextSize(longer, cv::FONT_HERSHEY_SIMPLEX, letter, width + 1, nullptr);
      if (line.empty() || size.width <= widest) {
        line = longer;
      } else {
        lines.push_back(word);
      }
    }
    return lines;
  }
};

void drawCurve(const Pen& pen, const estimation::Camera& camera, const lie::SE3& X_CB,
               const model::Shape& shape, const cv::Scalar& color, bool dashed) {
  std::optional<Eigen::Vector2d> last;
  int k = 0;
  for (const auto& point : model::sampleToTip(shape, shape.sectionCount() * kPoints)) {
    const auto pixel = camera.project(X_CB * point.X.translation);
    if (pixel && last && (!dashed || k % 2 == 1)) pen.line(*last, *pixel, color);
    last = pixel;
    ++k;
  }
}

cv::Scalar colorOf(const TagDetection& tag) {
  if (!tag.fitted) return kNotUsed;
  return tag.outlier ? kDoesNotFit : kFits;
}

}  // namespace

cv::Mat drawOverlay(const Measurement& measurement, const ObservationReport& report) {
  const vision::Observation& observation = measurement.observation;
  const estimation::ArmView& view = measurement.view;
  const model::Shape* model = measurement.modelShape();
  cv::Mat picture;
  cv::cvtColor(measurement.gray, picture, cv::COLOR_GRAY2BGR);
  const Pen pen(picture);
  if (model != nullptr) drawCurve(pen, view.camera, view.X_CB, *model, kModel, true);
  if (measurement.measured()) {
    drawCurve(pen, view.camera, view.X_CB * observation.fit.X_B0B, observation.fit.shape, kMeasured,
              false);
  }
  for (std::size_t i = 0; i < observation.detections.size(); ++i) {
    const vision::TagDetection& tag = observation.detections[i];
    const cv::Scalar color = colorOf(report.detections.tags[i]);
    for (int k = 0; k < 4; ++k) pen.line(tag.corners.col(k), tag.corners.col((k + 1) % 4), color);
    const Eigen::Vector2d right = tag.corners.rowwise().maxCoeff();
    pen.text(std::to_string(tag.id),
             {static_cast<int>(right.x()) + 3 * pen.width, static_cast<int>(right.y())},
             0.5 * pen.letter, color);
  }
  const int height = static_cast<int>(std::lround(32 * pen.letter));
  int row = 0;
  for (const std::string& text : report.lines) {
    for (const std::string& line : pen.wrapped(text, kTextShare * picture.cols)) {
      pen.text(line, {height / 3, height * ++row}, pen.letter, kMeasured);
    }
  }
  return picture;
}

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
  const std_msgs::Header header = toHeaderMsg(measurement.stamp, camera_frame_);
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
          secondsBetween(ros::Time::now(), stamp), far_stamps_.total());
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
