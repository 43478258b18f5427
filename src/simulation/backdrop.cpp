#include "backdrop.hpp"

#include <cmath>
#include <random>

#include <opencv2/imgproc.hpp>

namespace helix_arm::simulation {
namespace {

constexpr int kFractionBits = 4;  // of OpenCV's fixed-point coordinates
constexpr int kMostCorners = 8;

// A frame in the picture for drawing.
struct Place {
  cv::Point2d center;
  cv::Point2d right;  // of unit length

  cv::Point2d at(double x, double y) const {
    return {center.x + x * right.x - y * right.y, center.y + x * right.y + y * right.x};
  }
};

void fillBox(cv::Mat& picture, const Place& place, double x, double y, double half_width,
             double half_height, double gray) {
  const cv::Point2d corners[] = {
      place.at(x - half_width, y - half_height), place.at(x + half_width, y - half_height),
      place.at(x + half_width, y + half_height), place.at(x - half_width, y + half_height)};
  fillPolygon(picture, corners, 4, gray);
}

// Looks like the border of a tag, but its pattern has a four-fold symmetry, so that no family has a
// tag near it.
void paintMockTag(cv::Mat& picture, const Place& place, double half, bool hollow) {
  fillBox(picture, place, 0, 0, 1.3 * half, 1.3 * half, 225);
  fillBox(picture, place, 0, 0, half, half, 35);
  if (hollow) fillBox(picture, place, 0, 0, 0.5 * half, 0.5 * half, 215);
}

void paintCheckerboard(cv::Mat& picture, const Place& place, double half) {
  constexpr int kCells = 5;
  fillBox(picture, place, 0, 0, 1.2 * half, 1.2 * half, 230);
  const double cell = 2 * half / kCells;
  for (int i = 0; i < kCells * kCells; i += 2) {
    fillBox(picture, place, (i % kCells + 0.5) * cell - half, (i / kCells + 0.5) * cell - half,
            0.5 * cell, 0.5 * cell, 40);
  }
}

}  // namespace

void fillPolygon(cv::Mat& picture, const cv::Point2d* corners, int count, double gray) {
  cv::Point fixed[kMostCorners];
  const double scale = 1 << kFractionBits;
  for (int i = 0; i < count; ++i) {
    fixed[i] = {static_cast<int>(std::lround(corners[i].x * scale)),
                static_cast<int>(std::lround(corners[i].y * scale))};
  }
  cv::fillConvexPoly(picture, fixed, count, cv::Scalar(gray), cv::LINE_AA, kFractionBits);
}

cv::Mat paintBackdrop(int width, int height, int clutter, std::uint32_t seed) {
  cv::Mat picture(height, width, CV_8UC1);
  for (int y = 0; y < height; ++y) {
    uchar* row = picture.ptr<uchar>(y);
    for (int x = 0; x < width; ++x) {
      const double across = static_cast<double>(x) / width, down = static_cast<double>(y) / height;
      row[x] = static_cast<uchar>(std::lround(
          168 - 22 * down - 40 * ((across - 0.4) * (across - 0.4) + (down - 0.3) * (down - 0.3))));
    }
  }
  std::mt19937 generator(seed);
  enum Kind { kBox, kMockTag, kLine, kHollowMockTag, kCheckerboard, kKinds };
  for (int i = 0; i < clutter; ++i) {
    Place place;
    place.center.x = uniform(generator, 0, width);
    place.center.y = uniform(generator, 0, height);
    const double angle = uniform(generator, 0, 2 * CV_PI);
    place.right = {std::cos(angle), std::sin(angle)};
    const double size = uniform(generator, 0.02, 0.06) * width;
    const double stretch = uniform(generator, 0.5, 2.0);
    const double gray = uniform(generator, 60, 210);
    switch (i % kKinds) {
      case kBox:
        fillBox(picture, place, 0, 0, size, size * stretch, gray);
        break;
      case kMockTag:
      case kHollowMockTag:
        paintMockTag(picture, place, 0.4 * size, i % kKinds == kHollowMockTag);
        break;
      case kLine:
        fillBox(picture, place, 0, 0, 5 * size, 0.03 * size * stretch, gray);
        break;
      default:
        paintCheckerboard(picture, place, 0.7 * size);
        break;
    }
  }
  return picture;
}

}  // namespace helix_arm::simulation
