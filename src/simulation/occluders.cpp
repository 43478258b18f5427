#include "occluders.hpp"

#include <cmath>

#include "backdrop.hpp"

namespace helix_arm::simulation {
namespace {

constexpr double kWander = 0.4;  // of a bar from the middle, relative to the picture

}  // namespace

Occluders::Occluders(int count, std::mt19937& generator) : bars_(count) {
  const auto rate = [&generator] {
    const double speed = uniform(generator, 0.015, 0.05);
    return uniform(generator, -1, 1) < 0 ? -speed : speed;
  };
  const auto phase = [&generator] { return uniform(generator, 0, 2 * CV_PI); };
  for (Bar& bar : bars_) {
    bar.x_rate = rate();
    bar.x_phase = phase();
    bar.y_rate = rate();
    bar.y_phase = phase();
    bar.turn_rate = rate();
    bar.turn_phase = phase();
    bar.half_width = uniform(generator, 0.02, 0.04);
    bar.half_length = uniform(generator, 0.2, 0.4);
    bar.gray = uniform(generator, 50, 120);
  }
}

void Occluders::draw(int picture_number, cv::Mat& picture) const {
  const double width = picture.cols, height = picture.rows;
  for (const Bar& bar : bars_) {
    const double t = picture_number;
    const cv::Point2d center(width * (0.5 + kWander * std::sin(bar.x_rate * t + bar.x_phase)),
                             height * (0.5 + kWander * std::sin(bar.y_rate * t + bar.y_phase)));
    const double angle = bar.turn_rate * t + bar.turn_phase;
    const cv::Point2d right(std::cos(angle), std::sin(angle)), down(-right.y, right.x);
    const cv::Point2d a = bar.half_length * height * right, b = bar.half_width * height * down;
    const cv::Point2d corners[] = {center - a - b, center + a - b, center + a + b, center - a + b};
    fillPolygon(picture, corners, 4, bar.gray);
  }
}

}  // namespace helix_arm::simulation
