#include "ros_bridge/vision/overlay.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include <opencv2/imgproc.hpp>

#include "helix_arm/model/curve.hpp"

namespace helix_arm::ros_bridge {
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

}  // namespace helix_arm::ros_bridge
