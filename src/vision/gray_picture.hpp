#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <cstdint>

#include <opencv2/core.hpp>

#include "helix_arm/estimation/tag_layout.hpp"

namespace helix_arm::vision {

/// Samples a picture (CV_8UC1), which must outlive this object. Outside the picture, the gray
/// levels of its border apply. Coordinates are in pixels; (0, 0) is the centre of the first one.
class GrayPicture {
 public:
  explicit GrayPicture(const cv::Mat& gray)
      : data_(gray.data),
        step_(static_cast<std::ptrdiff_t>(gray.step[0])),
        columns_(gray.cols),
        rows_(gray.rows) {}

  bool contains(const estimation::Corners& corners) const {
    return corners.minCoeff() >= 0 && corners.row(0).maxCoeff() <= columns_ - 1 &&
           corners.row(1).maxCoeff() <= rows_ - 1;
  }

  /// Gray level at p, bilinear.
  float at(const Eigen::Vector2d& p) const {
    // In this order, NaN becomes 0.
    const float x = std::min(std::max(0.0F, static_cast<float>(p.x())), columns_ - 1.0F);
    const float y = std::min(std::max(0.0F, static_cast<float>(p.y())), rows_ - 1.0F);
    const int column = std::min(static_cast<int>(x), columns_ - 2);
    const int row = std::min(static_cast<int>(y), rows_ - 2);
    const float u = x - static_cast<float>(column), v = y - static_cast<float>(row);
    const std::uint8_t* upper = data_ + row * step_ + column;
    const std::uint8_t* lower = upper + step_;
    const float above = static_cast<float>(upper[0]) + u * static_cast<float>(upper[1] - upper[0]);
    const float below = static_cast<float>(lower[0]) + u * static_cast<float>(lower[1] - lower[0]);
    return above + v * (below - above);
  }

  /// The pixels nearest to n points on a line, one step apart.
  void ray(const Eigen::Vector2d& start, const Eigen::Vector2d& step, int n,
           std::int16_t* levels) const {
    // Fixed point with 16 fractional bits.
    const auto fixed = [](double value) { return static_cast<std::int64_t>(65536 * value); };
    std::int64_t x = fixed(start.x() + 0.5), y = fixed(start.y() + 0.5);
    const std::int64_t dx = fixed(step.x()), dy = fixed(step.y());
    const std::int64_t last_column = columns_ - 1, last_row = rows_ - 1;
    for (int j = 0; j < n; ++j, x += dx, y += dy) {
      const std::int64_t column = std::clamp<std::int64_t>(x >> 16, 0, last_column);
      const std::int64_t row = std::clamp<std::int64_t>(y >> 16, 0, last_row);
      levels[j] = data_[row * step_ + column];
    }
  }

 private:
  const std::uint8_t* data_;
  std::ptrdiff_t step_;
  int columns_, rows_;
};

}  // namespace helix_arm::vision
