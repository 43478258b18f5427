#pragma once

#include <cstdint>

#include <opencv2/core.hpp>

namespace helix_arm::simulation {

/// A number in [lower, upper) from a generator. It is the same on every machine, which the
/// distributions of the standard library do not guarantee.
template <class Generator>
double uniform(Generator& generator, double lower, double upper) {
  const double span = static_cast<double>(Generator::max() - Generator::min()) + 1.0;
  return lower + (upper - lower) * (static_cast<double>(generator() - Generator::min()) / span);
}

/// Fills a polygon, its corners in pixels, with smooth edges.
void fillPolygon(cv::Mat& picture, const cv::Point2d* corners, int count, double gray);

/// The background (CV_8UC1): soft light and `clutter` objects with edges like those of tags and
/// arms, without tags.
cv::Mat paintBackdrop(int width, int height, int clutter, std::uint32_t seed);

}  // namespace helix_arm::simulation
