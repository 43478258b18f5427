#pragma once

#include <cmath>
#include <cstdint>

#include <opencv2/imgproc.hpp>

#include "helix_arm/vision/tag_detector.hpp"

namespace helix_arm::test {

/// Draws the cells of a tag whose corners are at given pixels ((0, 0) the centre of the first) into
/// a gray picture: every pixel is the mean of 8 x 8 points of its area.
inline void drawTag(const vision::TagFamily& family, const cv::Mat& cells,
                    const estimation::Corners& corners, cv::Mat& picture) {
  constexpr double kBlack = 20, kWhite = 230;
  const auto low = static_cast<float>(family.quietCells());
  const auto high = static_cast<float>(family.quietCells() + family.borderCells());
  const cv::Point2f square[4] = {{low, high}, {high, high}, {high, low}, {low, low}};
  cv::Point2f seen[4];
  for (int k = 0; k < 4; ++k) {
    seen[k] = {static_cast<float>(corners(0, k)), static_cast<float>(corners(1, k))};
  }
  const cv::Matx33d to_cells = cv::getPerspectiveTransform(seen, square);
  // Where the picture of the cells ends up.
  const auto width = static_cast<float>(cells.cols), height = static_cast<float>(cells.rows);
  const std::vector<cv::Point2f> outline = {{0, 0}, {width, 0}, {width, height}, {0, height}};
  std::vector<cv::Point2f> outline_seen;
  cv::perspectiveTransform(outline, outline_seen, to_cells.inv());
  const cv::Rect part = (cv::boundingRect(outline_seen) + cv::Size(4, 4) - cv::Point(2, 2)) &
                        cv::Rect({0, 0}, picture.size());
  constexpr int kPoints = 8;
  for (int y = part.y; y < part.br().y; ++y) {
    for (int x = part.x; x < part.br().x; ++x) {
      double sum = 0;
      int inside = 0;
      for (int i = 0; i < kPoints * kPoints; ++i) {
        const double dx = (i % kPoints + 0.5) / kPoints - 0.5;
        const double dy = (i / kPoints + 0.5) / kPoints - 0.5;
        const cv::Vec3d p = to_cells * cv::Vec3d(x + dx, y + dy, 1);
        const double u = p[0] / p[2], v = p[1] / p[2];
        if (p[2] <= 0 || u < 0 || v < 0 || u >= cells.cols || v >= cells.rows) continue;
        const bool bright = cells.at<std::uint8_t>(static_cast<int>(v), static_cast<int>(u)) > 0;
        sum += bright ? kWhite : kBlack;
        ++inside;
      }
      const double share = static_cast<double>(inside) / (kPoints * kPoints);
      auto& pixel = picture.at<std::uint8_t>(y, x);
      pixel = cv::saturate_cast<std::uint8_t>(sum / (kPoints * kPoints) + (1 - share) * pixel);
    }
  }
}

/// Corners of a square of this size [px] about a centre, turned by an angle in the picture [rad].
inline estimation::Corners squareCorners(double x, double y, double size, double angle) {
  Eigen::Matrix2d turn;
  turn << std::cos(angle), -std::sin(angle), std::sin(angle), std::cos(angle);
  estimation::Corners square;
  square << -1, 1, 1, -1, 1, 1, -1, -1;
  return (turn * square * size / 2).colwise() + Eigen::Vector2d(x, y);
}

}  // namespace helix_arm::test
