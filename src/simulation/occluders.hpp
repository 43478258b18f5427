#pragma once

#include <random>
#include <vector>

#include <opencv2/core.hpp>

namespace helix_arm::simulation {

/// Bars that move through the picture, in front of everything else.
class Occluders {
 public:
  /// @param count  of bars, >= 0.
  Occluders(int count, std::mt19937& generator);

  /// Draws the bars at their positions in picture number picture_number.
  void draw(int picture_number, cv::Mat& picture) const;

 private:
  // In fractions of the picture and radians per picture.
  struct Bar {
    double x_rate, x_phase, y_rate, y_phase, turn_rate, turn_phase, half_width, half_length, gray;
  };

  std::vector<Bar> bars_;
};

}  // namespace helix_arm::simulation
